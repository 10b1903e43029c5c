"""THuman's scans and fits in the trees that people have."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.files.pickles import read_array_pickle
from harness.core.mesh import Mesh
from harness.data.manifest import Dataset
from harness.data.scans import load_scan
from harness.data.subjects import check_files, fit_of, load_subject, locate_subject, rotation_of

SCALE, HEIGHT_M, YAW_DEG = 0.4335, 1.7, 40.0


@pytest.fixture(scope="module")
def tree(stand_in):
    return stand_in("thuman_tree")


def person() -> Mesh:
    """A slab with a nose in metres: its face with the greatest z is where it looks."""
    points = [[-0.2, 0, 0], [0.2, 0, 0], [0.2, 1, 0], [-0.2, 1, 0], [0, 0.9, 0.15]]
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    return Mesh(np.array(points) * HEIGHT_M, faces, uv=np.zeros((5, 2)), face_uv=faces)


def in_units(turn: np.ndarray) -> Mesh:
    """The person in a scan's units, turned and somewhere."""
    transform = np.eye(4)
    transform[:3, :3] = SCALE * turn
    transform[:3, 3] = 5.0, -2.0, 1.0
    return person().transformed(transform)


def yaw(angle_deg: float) -> np.ndarray:
    return rotation_of(np.array([0.0, math.radians(angle_deg), 0.0]))


def rotvec(turn: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(turn).as_rotvec()


def dataset(**changes: object) -> Dataset:
    values = {"title": "T", "kind": "thuman", "licence": "own", "root": "x", "scale": "fit",
              "facing": "fit", "subjects": ("0021",), **changes}  # fmt: skip
    return Dataset.model_validate(values)


@pytest.fixture
def put(tree, tmp_path):
    """``put(subject, turn, fits=...)``: a subject whose scan and body are turned alike."""

    def write(subject: str = "0021", turn: np.ndarray | None = None, **names) -> Path:
        turn = yaw(YAW_DEG) if turn is None else turn
        fit = tree.fit_bytes(SCALE, np.zeros(3), global_orient=rotvec(turn))
        tree.write_subject(tmp_path, subject, in_units(turn), None, fit, **names)
        return tmp_path / tree.SCANS

    return write


def assert_stands(mesh: Mesh) -> None:
    """The person in metres, upright, facing +Z, centred."""
    wanted = person()
    centred = wanted.vertices - wanted.bounds.mean(axis=0)
    np.testing.assert_allclose(mesh.vertices, centred, atol=1e-5)


@pytest.mark.parametrize("root", ["", "THuman2.1_Release_", "THuman2.1_Release_/model"])
def test_the_fits_archive_is_found_below_or_beside_the_root(put, tmp_path, root):
    put()
    scan, mesh = load_subject("t", dataset(), tmp_path / root, "0021")
    assert_stands(mesh)
    assert scan.warnings == ()
    assert (scan.scale_rule, scan.facing_rule) == ("fit", "fit")
    located = locate_subject("t", dataset(), tmp_path / root, "0021")
    assert located.identity() == scan.identity()
    assert set(scan.sha256) == {"0021.obj", "material0.mtl", "material0.jpeg", "smplx_param.pkl"}
    assert "harness.data.subjects" in scan.reader["code"]
    checks = check_files(dataset(), tmp_path / root, "0021", {})
    assert [check.state for check in checks] == ["present"] * 4


@pytest.mark.parametrize(
    "fits", ["THuman2.1_smplx", "THuman_2_1_smplx", "thuman2.1_smplx", "my fits", "smplx_paras"]
)
def test_renamed_folders_of_fits(put, fits):
    assert_stands(load_subject("t", dataset(), put(fits=fits), "0021")[1])


def test_the_newer_fits_count_and_the_older_ones_are_told(put, tree):
    old = "THuman2.1_Release Smpl-X Paras"
    root = put(fits=old)
    scan, _ = load_subject("t", dataset(), root, "0021")
    assert "misaligned" in scan.warnings[0]
    assert "misaligned" in check_files(dataset(), root, "0021", {})[-1].note
    newer = root.parent / tree.FITS / "smplx" / "0021"
    newer.mkdir(parents=True)
    newer.joinpath("smplx_param.pkl").write_bytes(tree.fit_bytes(SCALE, np.zeros(3)))
    assert fit_of(dataset(), root, "0021") == newer / "smplx_param.pkl"
    assert fit_of(dataset(), root.parent, "0021") == newer / "smplx_param.pkl"
    other = root.parent / "THuman2.0_smplx_new" / "0021"
    other.mkdir(parents=True)
    other.joinpath("smplx_param.pkl").write_bytes(b"of another version")
    assert fit_of(dataset(), root, "0021") == newer / "smplx_param.pkl"


def test_where_both_find_the_fit_the_placement_is_that_of_all_scans(put, tmp_path):
    put()
    _, old = load_scan("t", dataset(), tmp_path, "0021")
    _, new = load_subject("t", dataset(), tmp_path, "0021")
    np.testing.assert_allclose(new.vertices, old.vertices, atol=1e-12)


def test_a_real_files_form_is_read_without_its_names(tree, tmp_path):
    path = tmp_path / "smplx_param.pkl"
    path.write_bytes(tree.fit_bytes(SCALE, np.ones(3)))
    assert b"ctrimesh.caching\nTrackedArray" in path.read_bytes()
    found = read_array_pickle(path)
    assert found["scale"].shape == ()
    assert found["scale"].item() == SCALE
    assert found["body_pose"].shape == (1, 63)


def test_the_body_of_a_fit_is_no_scan(put, tree, tmp_path):
    root = put()
    body = root.parent / tree.FITS / "smplx"
    (body / "0021" / "mesh_smplx.obj").write_text("v 0 0 0\n")
    with pytest.raises(DataError, match="holds fits and no scans.*beside"):
        load_subject("t", dataset(), body, "0021")
    points = np.random.default_rng(0).normal(size=(10475, 3))
    faces = np.arange(10473)[:, None] + np.arange(3)
    renamed = Mesh(points, faces, uv=np.zeros((1, 2)), face_uv=0 * faces)
    tree.write_subject(tmp_path / "b", "0022", renamed, None, tree.fit_bytes(1.0, np.zeros(3)))
    with pytest.raises(DataError, match="is the body of a fit and not a scan.*10475"):
        load_subject("t", dataset(), tmp_path / "b", "0022")


@pytest.mark.parametrize(
    "lying",
    [(math.pi / 2, 0, 0), (-math.pi / 2, 0, 0), (0, 0, math.pi / 2), (math.pi, 0, 0), (0, 0, 0)],
)
def test_a_later_scan_is_put_upright_by_its_fit(put, lying):
    turn = rotation_of(np.array(lying, dtype=float)) @ yaw(YAW_DEG)
    scan, mesh = load_subject("t", dataset(), put("0526", turn), "0526")
    assert_stands(mesh)
    assert any("turned by" in text for text in scan.warnings) == any(lying)


def test_a_later_scan_of_which_nobody_can_say_how_it_stands(put):
    leaning = rotation_of(np.array([math.radians(45), 0.0, 0.0]))
    with pytest.raises(DataError, match="'0600' does not stand upright.*leans too far"):
        load_subject("t", dataset(), put("0600", leaning), "0600")
    lying = rotation_of(np.array([math.pi / 2, 0.0, 0.0]))
    root = put("0601", lying)
    with pytest.raises(DataError, match="own frame is kept under the rule 'units'"):
        load_subject("t", dataset(scale="units"), root, "0601")
    # An early scan is upright whatever its fit says: people bend.
    scan, _ = load_subject("t", dataset(), put("0500", leaning), "0500")
    assert not any("turned" in text for text in scan.warnings)


def test_in_units_the_fit_only_tells_the_front(put):
    scan, mesh = load_subject("t", dataset(scale="units"), put(), "0021")
    np.testing.assert_allclose(mesh.vertices, in_units(yaw(YAW_DEG)).vertices, atol=1e-6)
    assert scan.front_yaw_deg == pytest.approx(YAW_DEG, abs=1e-4)
    plain, _ = load_subject("t", dataset(scale="units", facing="+z"), put("0022"), "0022")
    assert plain.front_yaw_deg == 0.0


def test_without_a_fit_or_with_a_foreign_one(put, tree):
    root = put()
    fit = root.parent / tree.FITS / "smplx" / "0021" / "smplx_param.pkl"
    fit.write_bytes(tree.fit_bytes(2e-4, np.zeros(3)))
    with pytest.raises(DataError, match="m high by its fit.*another scan"):
        load_subject("t", dataset(), root, "0021")
    fit.unlink()
    with pytest.raises(DataError, match="'0021' has no SMPL-X fit.*beside the scans"):
        load_subject("t", dataset(), root, "0021")
    assert check_files(dataset(), root, "0021", {})[-1].state == "missing"
