"""A sphere in every form that a method may return, against its radius."""

from __future__ import annotations

import contextlib
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, Reconstruction
from harness.core.camera import Camera, look_at
from harness.core.camera_frames import quaternion_from_rotation, rotation_from_quaternion
from harness.core.errors import DataError, MethodError
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo, Privilege
from harness.core.results import DepthMaps, Gaussians, PhotoFrame, PointCloud, Unmeshed, ViewDepth
from harness.files.point_files import load_points
from harness.geometry.coinciding import open_edges
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from harness.geometry.similarity import Similarity
from harness.run.external_meshes import score
from methods.points.clouds import outward_normals
from methods.points.filtering import MeshSettings
from methods.points.splats import cameras_around, directions, rendered_depth
from methods.points.surfacing import STEPS, load_surface, reconstructed
from tests.unit.methods.points.conftest import sphere

RADIUS_M = 0.5
COUNT = 20_000
SIZE = (200, 200)
#: A finest cell of 10 mm.
COARSE = {"mesh": asdict(MeshSettings(depth=7))}


def all_around(kind: str = "perspective") -> tuple[Camera, ...]:
    """Cameras that leave no part of a sphere unseen: a ring sees its poles at a grazing angle."""
    focal = 500.0 if kind == "perspective" else 180.0
    K = np.array([[focal, 0, SIZE[0] / 2], [0, focal, SIZE[1] / 2], [0, 0, 1.0]])
    ups = [(0, 0, 1) if abs(way[1]) > 0.9 else (0, 1, 0) for way in directions(14)]
    return tuple(
        Camera(K, look_at(3.0 * way, (0, 0, 0), up), *SIZE, kind)
        for way, up in zip(directions(14), ups, strict=True)
    )


@pytest.fixture(scope="module")
def photos(tmp_path_factory) -> Capture:
    return photographed(tmp_path_factory.mktemp("sphere"), all_around())


@pytest.fixture(scope="module")
def parallel(tmp_path_factory) -> Capture:
    return photographed(tmp_path_factory.mktemp("parallel"), all_around("orthographic"))


def photographed(folder: Path, cameras: tuple[Camera, ...]) -> Capture:
    caster = Raycaster(sphere(centre=np.zeros(3), rows=192))
    capture = Capture("toy", "sphere", "tiny", "key", folder, cameras)
    for view, camera in enumerate(cameras):
        alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
        save_png(
            capture.image_path(view), np.dstack([np.full((*alpha.shape, 3), 180, np.uint8), alpha])
        )
    return capture


class Returns:
    """A built-in method that returns what it is given."""

    def __init__(self, found: Unmeshed | None, *privileges: Privilege, **rooms) -> None:
        self._found = found
        self.info = MethodInfo("toy", "Toy", privileges=privileges, parameters={**COARSE, **rooms})

    def reconstruct(self, capture, context):
        return self._found


def made(found, photos, folder: Path, *privileges: Privilege, **rooms) -> Reconstruction:
    context = Context(0, folder, lambda _: contextlib.nullcontext(), keep=True)
    return reconstructed(Returns(found, *privileges, **rooms), photos, context)


def off_mm(mesh: Mesh) -> float:
    """The largest distance of a vertex from the sphere."""
    return 1000 * float(np.abs(np.linalg.norm(mesh.vertices, axis=1) - RADIUS_M).max())


def depth_maps(cameras) -> DepthMaps:
    """The sphere's depth, worked out: where each pixel's ray meets it."""
    views = []
    for camera in cameras:
        ray = camera.ray_directions(camera.pixel_centres().reshape(-1, 2))
        eye = camera.ray_origins(camera.pixel_centres().reshape(-1, 2))
        a, b = (ray**2).sum(axis=1), (ray * eye).sum(axis=1)
        inside = b**2 - a * ((eye**2).sum(axis=1) - RADIUS_M**2)
        with np.errstate(invalid="ignore"):
            depth = ((-b - np.sqrt(inside)) / a).reshape(camera.height, camera.width)
        views.append(ViewDepth(PhotoFrame.whole(camera.size, camera.size), camera, depth))
    return DepthMaps(tuple(views))


def cloud(normals: bool) -> PointCloud:
    ways = directions(COUNT)
    return PointCloud(RADIUS_M * ways, 2.0 * ways if normals else None)


def gaussians(flat: bool) -> Gaussians:
    """Centres on the sphere, as wide as they are apart; flat ones lie on it."""
    ways = directions(COUNT)
    turn = np.stack([1 + ways[:, 2], -ways[:, 1], ways[:, 0], np.zeros(COUNT)], axis=1)
    turn[turn[:, 0] < 1e-9] = (0, 1, 0, 0)
    width = 0.6 * np.sqrt(4 * np.pi * RADIUS_M**2 / COUNT)
    scales = np.full((COUNT, 3), width) * ((1, 1, 0) if flat else (1, 1, 1))
    rotations = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    return Gaussians(RADIUS_M * ways, scales, rotations, np.full(COUNT, 0.9))


SLOW = ("isotropic Gaussians", "flat Gaussians", "a cloud")
FORMS = {
    "depth maps": depth_maps,
    "a cloud": lambda _: cloud(normals=False),
    "a cloud with normals": lambda _: cloud(normals=True),
    "isotropic Gaussians": lambda _: gaussians(flat=False),
    "flat Gaussians": lambda _: gaussians(flat=True),
}


def marked(forms):
    """Gaussians take ten times as long as the others; a cloud is given normals, and then is one."""
    return [pytest.param(f, marks=pytest.mark.nightly if f in SLOW else ()) for f in forms]


@pytest.mark.slow
@pytest.mark.parametrize("form", marked(FORMS))
def test_a_sphere_in_any_form_is_within_a_millimetre(form, photos, tmp_path):
    result = made(FORMS[form](photos.cameras), photos, tmp_path)
    assert off_mm(result.mesh) < 1.0
    assert open_edges(result.mesh) == 0
    assert result.mesh.signed_volume > 0
    assert result.details["surface"] == STEPS
    assert (tmp_path / "points.npz").is_file()


@pytest.mark.nightly
@pytest.mark.parametrize("form", ["depth maps", "flat Gaussians"])
def test_a_sphere_seen_by_parallel_rays_is_within_a_millimetre(form, parallel, tmp_path):
    result = made(FORMS[form](parallel.cameras), parallel, tmp_path)
    assert off_mm(result.mesh) < 1.0
    assert open_edges(result.mesh) == 0


SOMEWHERE = Similarity(0.37, rotation_from_quaternion((0.5, 0.5, -0.5, 0.5)), np.array([3.0, 1, 2]))


def elsewhere(found: PointCloud | Gaussians, cameras) -> PointCloud | Gaussians:
    """The same in another world and unit, with the cameras there."""
    own = tuple(SOMEWHERE.camera(camera) for camera in cameras)
    if isinstance(found, PointCloud):
        normals = None if found.normals is None else found.normals @ SOMEWHERE.rotation.T
        return PointCloud(SOMEWHERE.points(found.positions), normals, own)
    turn = (SOMEWHERE.rotation @ each for each in found.axes())
    return Gaussians(
        SOMEWHERE.points(found.centres),
        SOMEWHERE.scale * found.scales,
        np.array([quaternion_from_rotation(each) for each in turn]),
        found.opacities,
        own,
    )


@pytest.mark.slow
@pytest.mark.parametrize("form", marked(["a cloud with normals", "a cloud", "flat Gaussians"]))
def test_scaled_turned_points_come_back_by_their_cameras(form, photos, tmp_path):
    moved = elsewhere(FORMS[form](photos.cameras), photos.cameras)
    result = made(moved, photos, tmp_path)
    assert off_mm(result.mesh) < 1.0
    alignment = result.details["alignment"]
    assert alignment["mode"] == "sim3_cameras"
    assert alignment["scale"] == pytest.approx(1 / SOMEWHERE.scale)
    assert alignment["centre_rms_mm"] < 1e-3


@pytest.mark.nightly
def test_what_is_in_its_own_frame_stays_there_for_the_protocol(photos, tmp_path):
    moved = replace(elsewhere(cloud(normals=False), photos.cameras), cameras=None)
    result = made(moved, photos, tmp_path, Privilege.OWN_FRAME)
    middle = SOMEWHERE.points(np.zeros((1, 3)))
    off = np.linalg.norm(result.mesh.vertices - middle, axis=1) - SOMEWHERE.scale * RADIUS_M
    assert np.abs(off).max() < 0.001
    assert result.details["alignment"] == {"mode": "protocol"}


def test_points_beside_a_mask_and_far_from_others_go(photos, tmp_path):
    surface = cloud(normals=False).positions
    across = photos.cameras[0].rotation[:2]
    around = np.linspace(0, 2 * np.pi, 500)
    beside = 0.57 * np.stack([np.cos(around), np.sin(around)], axis=1) @ across
    inside = np.array([[0.0, 0.0, 0.0]])
    whole = PointCloud(np.concatenate([surface, beside, inside]))
    shares = made(whole, photos, tmp_path).details["kept_shares"]
    assert shares["mask"] == pytest.approx(20_001 / 20_501, abs=1e-4)
    assert shares["outliers"] == pytest.approx(20_000 / 20_001, abs=1e-4)


def test_normals_face_outwards_where_a_surface_faces_itself():
    """Two spheres a tenth of their size apart: between them, centres say nothing of sides."""
    ways = directions(4000)
    centres = np.repeat([[-0.55, 0, 0], [0.55, 0, 0]], len(ways), axis=0)
    normals = np.tile(ways, (2, 1))
    found = outward_normals(centres + 0.5 * normals)
    assert np.einsum("ni,ni->n", found, normals).min() > 0.95
    with pytest.raises(MethodError, match="on one plane"):
        outward_normals(np.random.default_rng(0).uniform(size=(200, 3)) * (1, 1, 0))


@pytest.mark.parametrize("found", [None, "a mesh", Reconstruction(mesh=None)])  # type: ignore[arg-type]
def test_what_is_no_result_is_said(found, photos, tmp_path):
    with pytest.raises(MethodError, match="returned no mesh"):
        made(found, photos, tmp_path)


def write_gaussians(path: Path, found: Gaussians, scales: int = 3) -> None:
    """As 3DGS and 2DGS write them."""
    columns = {name: found.centres[:, axis] for axis, name in enumerate("xyz")}
    columns["opacity"] = np.log(found.opacities / (1 - found.opacities))
    columns |= {f"scale_{axis}": np.log(found.scales[:, axis]) for axis in range(scales)}
    columns |= {f"rot_{axis}": 2.0 * found.rotations[:, axis] for axis in range(4)}
    write_points(path, columns)


def write_points(path: Path, columns: dict[str, np.ndarray]) -> None:
    rows = np.stack(list(columns.values()), axis=1).astype("<f4")
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    lines += [f"property float {name}" for name in columns]
    path.write_bytes("\n".join([*lines, "end_header\n"]).encode() + rows.tobytes())


@pytest.mark.parametrize("flat", [False, True])
def test_files_of_gaussians_are_read_back(flat, tmp_path):
    there = gaussians(flat)
    write_gaussians(tmp_path / "g.ply", there, 2 if flat else 3)
    found = load_points(tmp_path / "g.ply")
    assert isinstance(found, Gaussians)
    np.testing.assert_allclose(found.scales, there.scales, atol=1e-7)
    np.testing.assert_allclose(found.opacities, there.opacities, atol=1e-6)
    np.testing.assert_allclose(found.axes(), there.axes(), atol=1e-6)
    write_points(tmp_path / "g.ply", {**dict.fromkeys("xyz", np.zeros(3)), "opacity": np.zeros(3),
                                      "scale_0": np.zeros(3)})  # fmt: skip
    with pytest.raises(DataError, match="Gaussians without scale_1, rot_0"):
        load_points(tmp_path / "g.ply")


@pytest.mark.slow
def test_files_of_points_and_gaussians_are_scored_as_surfaces(tmp_path):
    """The harness's own settings, which make cells of 2 mm."""
    truth = sphere(centre=np.zeros(3), rows=192)
    there = cloud(normals=True)
    columns = {name: there.positions[:, axis] for axis, name in enumerate("xyz")}
    columns |= {f"n{name}": there.normals[:, axis] for axis, name in enumerate("xyz")}
    write_points(tmp_path / "cloud.ply", columns)
    found = score(tmp_path / "cloud.ply", truth, "exact")
    assert found.metrics["chamfer"].value < 0.5
    assert load_surface(tmp_path / "cloud.ply").details["surface"] == STEPS


def test_gaussians_without_cameras_are_seen_from_all_sides():
    found = gaussians(flat=True)
    cameras = cameras_around(found.centres)
    assert len(cameras) > 20
    small = cameras[3].resized(64, 64)
    depth, opacity = rendered_depth(found, small)
    assert np.isfinite(depth).sum() > 300
    assert opacity.max() > 0.9
    near = np.linalg.norm(small.position) - RADIUS_M
    assert np.nanmin(depth) == pytest.approx(near, abs=0.002)
