"""Scans become metres in the world frame by the manifest's rule, in every known layout."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.data.manifest import Dataset
from harness.data.scans import load_scan, load_world_mesh, locate_scan
from harness.data.thuman import check_thuman, find_subject
from harness.files.obj import write_obj

FIT_SCALE = 0.4335


def wedge(height: float) -> Mesh:
    """A slab with a nose: its face with the greatest z is where it looks."""
    vertices = np.array(
        [[-0.2, 0, 0], [0.2, 0, 0], [0.2, 1, 0], [-0.2, 1, 0], [0, 0.9, 0.15]], dtype=float
    )
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    return Mesh(vertices * height, faces, uv=np.zeros((5, 2)), face_uv=faces)


def turned(mesh: Mesh, yaw_deg: float) -> Mesh:
    yaw = math.radians(yaw_deg)
    transform = np.eye(4)
    transform[:3, :3] = [
        [math.cos(yaw), 0, math.sin(yaw)],
        [0, 1, 0],
        [-math.sin(yaw), 0, math.cos(yaw)],
    ]
    transform[:3, 3] = (5.0, -2.0, 1.0)
    return mesh.transformed(transform)


def write_scan(folder: Path, subject: str, mesh: Mesh) -> None:
    folder.mkdir(parents=True)
    write_obj(folder / f"{subject}.obj", mesh)
    (folder / "material0.mtl").write_text("newmtl material0\nmap_Kd material0.jpeg\n")
    Image.new("RGB", (8, 8), (200, 100, 50)).save(folder / "material0.jpeg")


def write_fit(path: Path, yaw_deg: float) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    fit = {
        "scale": np.array([FIT_SCALE]),
        "global_orient": np.array([[0, math.radians(yaw_deg), 0]], dtype=np.float32),
        "betas": np.zeros((1, 10), np.float32),
    }
    path.write_bytes(pickle.dumps(fit))


def dataset(**changes: object) -> Dataset:
    values = {
        "title": "Scans", "kind": "thuman", "licence": "own", "root": "scans", "scale": "metres",
        "facing": "+z", "subjects": ("0001",), **changes,
    }  # fmt: skip
    return Dataset.model_validate(values)


@pytest.mark.parametrize(
    ("scan", "fit"),
    [
        ("model/0001", "smplx/0001/smplx_param.pkl"),
        ("0001", "0001/smplx_param.pkl"),
        ("THuman2.1/model/0001", "THuman2.1/smplx/0001/smplx_param.pkl"),
        ("scans/0001", "fits/0001/smplx_param.pkl"),
    ],
)
def test_every_layout_with_scale_and_facing_of_the_fit(tmp_path, scan, fit):
    true_height = 1.7
    write_scan(tmp_path / scan, "0001", turned(wedge(true_height * FIT_SCALE), 40))
    write_fit(tmp_path / fit, 40)
    found, mesh = load_scan("t", dataset(scale="fit", facing="fit"), tmp_path, "0001")
    assert mesh.extent[1] == pytest.approx(true_height, abs=1e-5)
    np.testing.assert_allclose(mesh.bounds.sum(axis=0), 0, atol=1e-9)
    assert mesh.vertices[4, 2] == pytest.approx(mesh.vertices[:, 2].max())
    assert mesh.vertices[4, 0] == pytest.approx(0, abs=1e-5)
    assert found.warnings == ()
    np.testing.assert_allclose(load_world_mesh(found).vertices, mesh.vertices)


def test_height_and_yaw_given_by_the_manifest(tmp_path):
    write_scan(tmp_path / "model/0001", "0001", turned(wedge(0.58), -90))
    rule = dataset(scale="height=1.8", facing={"0001": -90.0})
    _, mesh = load_scan("t", rule, tmp_path, "0001")
    assert mesh.extent[1] == pytest.approx(1.8)
    assert mesh.vertices[4, 2] == pytest.approx(mesh.vertices[:, 2].max())
    with pytest.raises(DataError, match="where subject '0001' faces"):
        load_scan("t", dataset(facing={"0002": 0.0}), tmp_path, "0001")


def test_a_scan_of_the_wrong_scale_is_refused_or_reported(tmp_path):
    write_scan(tmp_path / "model/mm", "mm", wedge(1700))
    write_scan(tmp_path / "model/small", "small", wedge(0.9))
    with pytest.raises(
        DataError, match=r"1700 m high under the rule 'scale: metres'.*correct 'scale'"
    ):
        load_scan("t", dataset(), tmp_path, "mm")
    found, _ = load_scan("t", dataset(), tmp_path, "small")
    assert "outside 1.2 to 2.2 m" in found.warnings[0]


def test_missing_scan_and_missing_fit_say_where_they_belong(tmp_path):
    with pytest.raises(DataError, match=r"no scan of subject '0001'.*model/0001/0001\.obj"):
        find_subject(tmp_path, "0001")
    write_scan(tmp_path / "model/0001", "0001", wedge(1.7))
    with pytest.raises(DataError, match=r"has no SMPL-X fit.*smplx/0001/smplx_param\.pkl"):
        load_scan("t", dataset(scale="fit"), tmp_path, "0001")


def test_identity_follows_content_and_rule_not_place(tmp_path):
    for place in ("a", "b"):
        write_scan(tmp_path / place / "model/0001", "0001", wedge(1.7))
    first = locate_scan("t", dataset(), tmp_path / "a", "0001").identity()
    assert locate_scan("t", dataset(), tmp_path / "b", "0001").identity() == first
    other_rule = locate_scan("t", dataset(scale="height=1.7"), tmp_path / "a", "0001").identity()
    assert other_rule != first
    Image.new("RGB", (8, 8)).save(tmp_path / "b/model/0001/material0.jpeg")
    assert locate_scan("t", dataset(), tmp_path / "b", "0001").identity() != first


def test_check_tells_present_missing_and_corrupt(tmp_path):
    write_scan(tmp_path / "model/0001", "0001", wedge(1.7))
    (tmp_path / "model/0001/material0.mtl").write_bytes(b"")
    checks = check_thuman(
        tmp_path, "0001", needs_fit=True, sha256={"model/0001/0001.obj": "0" * 64}
    )
    states = {Path(check.path).name: (check.state, check.note) for check in checks}
    assert states["0001.obj"][0] == "corrupt"
    assert "expected 000000000000" in states["0001.obj"][1]
    assert states["material0.mtl"] == ("corrupt", "empty file")
    assert states["material0.jpeg"] == ("present", "")
    assert states["smplx_param.pkl"] == ("missing", "")
    assert {c.state for c in check_thuman(tmp_path, "9", needs_fit=True, sha256={})} == {"missing"}


def test_a_scan_in_its_own_units_is_neither_scaled_nor_centred_nor_turned(tmp_path):
    # 0.58 units high and standing elsewhere: no person in metres, and nothing to refuse or report.
    there = turned(wedge(0.58), 40)
    write_scan(tmp_path / "model/0001", "0001", there)
    rule = dataset(scale="units")
    found, mesh = load_scan("t", rule, tmp_path, "0001")
    np.testing.assert_allclose(mesh.vertices, there.vertices, atol=1e-6)
    np.testing.assert_array_equal(found.scan_to_world, np.eye(4))
    np.testing.assert_allclose(load_world_mesh(found).vertices, mesh.vertices)
    assert found.warnings == ()
    assert mesh.texture is not None
    assert found.identity()["scale_rule"] == "units"
    assert found.front_yaw_deg == 0.0


def test_in_its_own_units_the_facing_only_says_where_the_front_is(tmp_path):
    there = turned(wedge(0.58), 40)
    write_scan(tmp_path / "model/0001", "0001", there)
    write_fit(tmp_path / "smplx/0001/smplx_param.pkl", 40)
    for facing in ("fit", {"0001": 40.0}):
        found, mesh = load_scan("t", dataset(scale="units", facing=facing), tmp_path, "0001")
        assert found.front_yaw_deg == pytest.approx(40.0, abs=1e-4)
        np.testing.assert_allclose(mesh.vertices, there.vertices, atol=1e-6)
    # A rule that turns the scan leaves nothing to tell.
    turned_scan, _ = load_scan("t", dataset(scale="height=1.7", facing="fit"), tmp_path, "0001")
    assert turned_scan.front_yaw_deg == 0.0


def test_a_link_out_of_the_root_is_no_scan(tmp_path):
    (tmp_path / "elsewhere" / "0001").mkdir(parents=True)
    (tmp_path / "elsewhere" / "0001" / "0001.obj").write_text("v 0 0 0\n")
    (tmp_path / "mine").symlink_to("elsewhere")
    assert find_subject(tmp_path / "mine", "0001").mesh.is_file()
    (tmp_path / "root").mkdir()
    (tmp_path / "root" / "0001").symlink_to("../elsewhere/0001")
    with pytest.raises(DataError, match="outside the folders that were given"):
        find_subject(tmp_path / "root", "0001")
