"""A mesh in another unit, place or frame: a method's own is measured, a file's is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.core.artifacts import Capture, Reconstruction, Scan
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.records import Record
from harness.core.settings import MetricProtocol
from harness.core.typed_json import to_json
from harness.data.manifest import Dataset
from harness.files.mesh_files import save_mesh
from harness.run.cell import Truth, scores_of
from harness.run.external_meshes import FolderRequest, score, score_folder
from harness.run.progress import Silent
from harness.run.sources import ScanSet
from harness.run.store import RunStore

PROTOCOL = MetricProtocol("mexecon", 2, 2000, "independent", "sample-to-sample")
#: Neither body nor normals are scored here, so no photo is looked at.
NO_PHOTOS = Capture("toy", "person", "none", "key", Path(), ())
MISTAKES = {
    "millimetres": (np.eye(3) * 1000, (0.0, 0.0, 0.0), "units?"),
    "feet at the origin": (np.eye(3), (0.0, 0.9, 0.0), "frame?"),
    "Z up": (np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]), (0.0, 0.0, 0.0), "frame?"),
}


def person() -> Mesh:
    """A block with a head to one side, so that it fits in one position alone."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = np.array(
        [
            *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
            *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
        ]
    )
    trunk, head = corners * (0.25, 0.7, 0.15), corners * (0.1, 0.2, 0.1) + (0.1, 0.9, 0.05)
    vertices = np.vstack([trunk, head])
    vertices -= (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return Mesh(vertices, np.vstack([faces, faces + 8]), source="person")


def write_scan(folder) -> None:
    """The person as a textured scan in THuman's layout."""
    folder.mkdir(parents=True)
    mesh = person()
    textured = replace(mesh, uv=np.zeros((1, 2)), face_uv=np.zeros_like(mesh.faces))
    save_mesh(folder / f"{folder.name}.obj", textured)
    (folder / "material0.mtl").write_text("newmtl material0\nmap_Kd material0.jpeg\n")
    Image.new("RGB", (4, 4), "white").save(folder / "material0.jpeg")


def misplaced(name: str) -> Mesh:
    turn, shift, _ = MISTAKES[name]
    mesh = person()
    return replace(mesh, vertices=mesh.vertices @ turn.T + shift)


@pytest.mark.parametrize("name", MISTAKES)
def test_a_methods_own_result_is_a_number_with_a_warning(name):
    scan = Scan("toy", "t1", person().source, "metres", "+z", np.eye(4), {})
    result = Reconstruction(mesh=misplaced(name))
    told = scores_of(result, NO_PHOTOS, Truth.read(scan, person()), PROTOCOL)
    assert all(np.isfinite(metric.value) for metric in told.metrics.values())
    assert told.metrics["chamfer"].value > 50
    (warning,) = [text for text in told.warnings if MISTAKES[name][2] in text]
    json.dumps(to_json(told), allow_nan=False)
    assert "person" in warning


@pytest.mark.parametrize("name", MISTAKES)
def test_a_pair_of_files_is_refused(tmp_path, name):
    save_mesh(tmp_path / "mine.ply", misplaced(name))
    save_mesh(tmp_path / "truth.ply", person())
    with pytest.raises(DataError) as refusal:
        score(tmp_path / "mine.ply", tmp_path / "truth.ply", PROTOCOL)
    assert MISTAKES[name][2] in str(refusal.value)


def scored_folder(tmp_path, subjects, protocol=PROTOCOL) -> list[Record]:
    """Records of the meshes in ``mine``, measured against the person under each subject's name."""
    for subject in subjects:
        write_scan(tmp_path / "scans" / "model" / subject)
    dataset = Dataset.model_validate(
        {
            "title": "Toy",
            "kind": "thuman",
            "licence": "CC0-1.0",
            "root": "scans",
            "scale": "metres",
            "facing": "+z",
            "subjects": subjects,
        }
    )
    request = FolderRequest(
        folder=tmp_path / "mine",
        name="mine",
        title="Mine",
        truth=ScanSet("toy", dataset, tmp_path / "scans", tuple(subjects)),
        protocol=protocol,
        store=RunStore(tmp_path / "runs"),
    )
    return [outcome.record for outcome in score_folder(request, Silent())]


def test_a_folder_of_files_is_refused_mesh_by_mesh(tmp_path):
    subjects = [f"t{index}" for index in range(1, 5)]
    for subject, mesh in zip(subjects, (person(), *map(misplaced, MISTAKES)), strict=True):
        save_mesh(tmp_path / "mine" / f"{subject}.ply", mesh)
    records = scored_folder(tmp_path, subjects)
    assert [record.status for record in records] == ["ok", "failed", "failed", "failed"]
    for record, (_, _, word) in zip(records[1:], MISTAKES.values(), strict=True):
        assert word in record.reason


def test_a_link_out_of_a_folder_of_files_is_refused(tmp_path):
    (tmp_path / "mine").mkdir()
    save_mesh(tmp_path / "elsewhere.ply", person())
    (tmp_path / "mine" / "a.ply").symlink_to(tmp_path / "elsewhere.ply")
    with pytest.raises(DataError, match="mine names a file outside the folders"):
        scored_folder(tmp_path, ["a"])


def test_records_of_a_folder_name_files_without_the_machines_folders(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "t1.ply").write_text("ply or so")
    broken, missing = scored_folder(tmp_path, ["t1", "t2"])
    assert (broken.status, missing.status) == ("failed", "missing")
    assert broken.reason.startswith("mine/t1.ply")
    assert missing.reason == "no mesh of t2 in mine"


def test_a_mesh_with_a_texture_is_kept_without_its_seams_and_says_so(tmp_path):
    write_scan(tmp_path / "scans" / "model" / "t2")
    (tmp_path / "mine").mkdir()
    (tmp_path / "scans" / "model" / "t2" / "t2.obj").rename(tmp_path / "mine" / "t1.obj")
    save_mesh(tmp_path / "mine" / "t2.ply", person())
    shutil.rmtree(tmp_path / "scans")
    split = replace(PROTOCOL, texture_seams="split")
    textured, plain = scored_folder(tmp_path, ["t1", "t2"], split)
    assert (textured.status, plain.status) == ("ok", "ok")
    assert set(textured.files) == set(plain.files) == {"mesh.ply"}
    assert [text for text in textured.warnings if "seams of its texture" in text]
    assert not [text for text in plain.warnings if "seams" in text]
