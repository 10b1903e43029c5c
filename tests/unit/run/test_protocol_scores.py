"""The meshes of a run under several protocols: filed beside the records, ranked in a table."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from harness.core.artifacts import Body
from harness.core.errors import HarnessError
from harness.core.field_protocols import FIELD_PROTOCOLS
from harness.core.files.npz import write_npz
from harness.core.mesh import Mesh
from harness.core.protocol_scores import RunScores
from harness.core.settings import MetricProtocol
from harness.data.manifest import Dataset
from harness.files.mesh_files import save_mesh
from harness.report.tables import (
    ReportRequest,
    build_published,
    scores_of,
    table_of_protocols,
    table_of_scores,
)
from harness.run.external_meshes import FolderRequest, score_folder
from harness.run.frames import read_record_file, write_record_file
from harness.run.progress import Silent
from harness.run.protocol_scores import (
    _CHAINS,
    _JOINTS,
    _rotations,
    body_score,
    score_protocols,
)
from harness.run.sources import ScanSet
from harness.run.store import RunStore
from methods.body.models.anny_body import AnnyBody
from metrics.body import BODY_PROTOCOLS
from reports.figures.charts import rank_curves
from reports.tables.geometry import geometry_table
from tests.spheres import icosphere

OWN = MetricProtocol("mexecon", 2, 2000, "independent", "sample-to-sample")
OTHERS = [FIELD_PROTOCOLS[name] for name in ("xavatar", "canonicalfusion", "volume")]
SUBJECTS = ("s1", "s2", "s3", "s4")


def egg(wide: float, high: float = 0.9) -> Mesh:
    ball = icosphere(1.0, 4)
    return replace(ball, vertices=ball.vertices * (wide, high, wide), source="egg")


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """Two methods: one makes all a little wide, one makes all small but of the right shape."""
    place = tmp_path_factory.mktemp("place")
    for number, subject in enumerate(SUBJECTS):
        wide = 0.3 + 0.01 * number
        folder = place / "scans" / "model" / subject
        folder.mkdir(parents=True)
        scan = egg(wide)
        textured = replace(scan, uv=np.zeros((1, 2)), face_uv=np.zeros_like(scan.faces))
        save_mesh(folder / f"{subject}.obj", textured)
        (folder / "material0.mtl").write_text("newmtl material0\nmap_Kd material0.jpeg\n")
        Image.new("RGB", (4, 4), "white").save(folder / "material0.jpeg")
        for name, mesh in (("wide", egg(wide + 0.02)), ("small", egg(0.9 * wide, 0.81))):
            (place / name).mkdir(exist_ok=True)
            save_mesh(place / name / f"{subject}.ply", mesh)
    return place


@pytest.fixture(scope="module")
def truth(place) -> ScanSet:
    dataset = Dataset(
        title="Eggs", kind="thuman", licence="own", root="scans", scale="metres", facing="+z",
        subjects=SUBJECTS,
    )  # fmt: skip
    return ScanSet("eggs", dataset, place / "scans", SUBJECTS)


def run_under(place, truth, protocol, run) -> RunStore:
    store = RunStore(place / run)
    for name in ("wide", "small"):
        request = FolderRequest(place / name, name, name, truth, protocol, store)
        assert all(outcome.status == "ok" for outcome in score_folder(request, Silent()))
    return store


def test_each_protocol_ranks_the_methods_in_its_own_way(place, truth):
    """Where each mesh is scaled by itself, the small one is perfect."""
    store = run_under(place, truth, OWN, "run")
    with pytest.raises(HarnessError, match="no further protocol"):
        table_of_protocols(store, ReportRequest())
    score_protocols(store, truth, OTHERS, ["wide", "small"], Silent())
    table = table_of_protocols(store, ReportRequest())
    wide, small = (
        {row.method: row for row in table.rows}[name].cells for name in ("wide", "small")
    )
    assert (wide["mexecon_rank"].value, small["mexecon_rank"].value) == (1, 2)
    assert (wide["canonicalfusion_rank"].value, small["canonicalfusion_rank"].value) == (2, 1)
    assert (small["canonicalfusion_rank"].low, small["canonicalfusion_rank"].high) == (1, 1)
    assert small["canonicalfusion_distance"].value < 1e-4
    assert wide["volume_volume_iou"].value > small["volume_volume_iou"].value
    assert wide["volume_rank"].value == 1
    picture = rank_curves(table, place / "ranks.png", "eggs")
    with Image.open(picture) as image:
        assert image.size[0] > 300
    titles = [column.title for column in table.columns]
    assert titles[:4] == ["mexecon chamfer", "rank", "xavatar cd_mean", "rank"]


def test_a_file_of_records_has_the_scores_beside_it(place, truth):
    store = run_under(place, truth, OWN, "filed")
    score_protocols(store, truth, OTHERS[:1], ["wide", "small"], Silent())
    file, records = place / "filed.jsonl", store.records()
    write_record_file(records, file)
    scores_of(store, records).save(file)
    found = table_of_scores(read_record_file(file), RunScores.beside(file), ReportRequest())
    assert found.rows == table_of_protocols(store, ReportRequest()).rows


@pytest.fixture
def bodies(tmp_path):
    """What files a true and a fitted body, turned by 90 degrees about the vertical, by change."""

    def filed(change=None, pose=None, names=NAMES):
        random = np.random.default_rng(0)
        joints, vertices = random.normal(size=(len(NAMES), 3)), random.normal(size=(50, 3))
        rest = np.tile(np.eye(4), (len(NAMES), 1, 1))
        truth = {"vertices": vertices, "joints": joints, "joint_names": np.array(NAMES),
                 "pose_parameters": rest}  # fmt: skip
        np.savez(tmp_path / "true.npz", **truth)
        placed = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
        scan = SimpleNamespace(body_path=tmp_path / "true.npz", scan_to_world=placed)
        turned, moved = (each @ placed[:3, :3].T for each in (joints, vertices))
        if change is not None:
            turned[[NAMES.index(name) for name in change]] += (0, 0.01, 0)
        parameters = {} if pose is None else {"pose_parameters": pose(rest.copy())}
        body = Body("anny", moved + np.array([0.003, 0, 0]), turned, np.zeros((0, 3), np.int32),
                    parameters, joint_names=names)  # fmt: skip
        write_npz(tmp_path / "body.npz", body.to_arrays())
        return {
            name: body_score(tmp_path / "body.npz", scan, protocol, "")
            for name, protocol in BODY_PROTOCOLS.items()
        }

    return filed


NAMES = tuple(dict.fromkeys([*_JOINTS.values(), *(bone for chain in _CHAINS for bone in chain)]))
LENGTHS = {"mpjpe", "pa_mpjpe", "pve", "pa_pve"}


def test_a_body_is_measured_by_its_joints_in_the_places_of_smpls(bodies):
    """Elbows and wrists 10 mm off, of 24 joints or of LSP's 14; both roots stay where they are."""
    arms = [f"{name}.{side}" for name in ("lowerarm01", "wrist") for side in "LR"]
    found = bodies(arms)
    for name, count in (("body-emdb", 24), ("body-3dpw14", 14)):
        numbers = found[name].metrics
        assert numbers["mpjpe"].value == pytest.approx(10 * 4 / count)
        assert numbers["pve"].value == pytest.approx(3)
        assert set(numbers) == LENGTHS
    assert found["body-emdb"].reason.endswith("so no rotations, in the result's body.npz")
    assert found["body-3dpw14"].reason == ""
    assert "not the crown" in found["body-3dpw14"].protocol.settings["differs"]
    other = bodies(names=NAMES[::-1])["body-emdb"]
    assert (other.metrics, "not both Anny's" in other.reason) == ({}, True)
    alone = SimpleNamespace(body_path=None, subject="0004")
    without = body_score(Path("body.npz"), alone, BODY_PROTOCOLS["body-emdb"], "")
    assert (without.metrics, without.reason) == ({}, "the scan of '0004' has no true body")


def test_angles_are_of_joints_with_all_that_their_bones_hang_on(bodies):
    """The body stands as the scan does but for a trunk that leans by 20 degrees: shoulders and
    elbows, four of nine joints, lean with it; a wrist is no joint of the protocol.
    """

    def leaning(pose):
        placed = Rotation.from_euler("z", 90, degrees=True).as_matrix()
        pose[NAMES.index("root"), :3, :3] = placed
        pose[NAMES.index("spine03"), :3, :3] = Rotation.from_rotvec([0.349066, 0, 0]).as_matrix()
        pose[NAMES.index("wrist.L"), :3, :3] = placed
        return pose

    found = bodies(pose=leaning)["body-emdb"]
    assert found.metrics["mpjae"].value == pytest.approx(20 * 4 / 9, abs=1e-3)
    assert found.metrics["mpjae"].unit == "deg"
    assert found.reason == ""
    assert set(found.metrics) == LENGTHS | {"mpjae", "pa_mpjae"}


def test_rotations_are_those_of_anny():
    pytest.importorskip("anny")
    body = AnnyBody()
    pose = np.tile(np.eye(4), (len(body.joint_names), 1, 1))
    pose[:, :3, :3] = Rotation.random(len(pose), random_state=0).as_matrix()
    found = _rotations(pose, body.joint_names, np.eye(3), BODY_PROTOCOLS["body-emdb"])
    turns = body.posed_as(pose, {}).turns[0].numpy()
    assert len(found) == 9
    for smpl, rotation in found.items():
        np.testing.assert_allclose(
            rotation, turns[body.joint_names.index(_JOINTS[smpl])], atol=1e-5
        )


def test_what_was_measured_stays_and_a_changed_protocol_is_refused(place, truth):
    store = run_under(place, truth, OWN, "again")
    found = score_protocols(store, truth, OTHERS[:1], ["wide", "small"], Silent())
    file = store.cell("wide", "s1").directory / "protocols.json"
    before = file.stat().st_mtime_ns
    assert score_protocols(store, truth, OTHERS[:1], ["wide", "small"], Silent()) == found
    assert file.stat().st_mtime_ns == before
    changed = replace(OTHERS[0], samples=5000)
    score_protocols(store, truth, [changed], ["wide"], Silent())
    with pytest.raises(HarnessError, match="changed under its name"):
        table_of_protocols(store, ReportRequest())


def test_rows_of_a_protocol_of_the_field_stand_above_what_is_printed_under_it(place, truth):
    sith = replace(FIELD_PROTOCOLS["sith"], samples=3000)
    store = run_under(place, truth, sith, "sith")
    records = store.records()
    table = geometry_table(records)
    assert [column.id for column in table.columns] == [
        "p_to_s",
        "s_to_p",
        "nc",
        "f_score",
        "box_iou",
    ]
    assert table.columns[0].unit == "mm"
    text = build_published(ReportRequest(), sith, records)
    assert text.index("| wide") < text.index("1.871 cm")
    assert "trained on THuman2.0" in text
    with pytest.raises(HarnessError, match="no number that was printed under protocol icon"):
        build_published(ReportRequest(), FIELD_PROTOCOLS["icon"])
