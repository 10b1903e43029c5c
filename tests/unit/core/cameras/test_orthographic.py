"""The orthographic camera against closed forms: projection, a sphere, and its files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from harness.core.camera_frames import write_colmap, write_transforms_json
from harness.core.errors import DataError
from harness.core.rigs import RingRig
from harness.data.camera_files import write_published
from harness.data.colmap import write_colmap_binary
from harness.geometry.outline import Outline
from harness.geometry.place import place_of
from harness.geometry.raycast import Raycaster
from harness.geometry.similarity import Similarity
from methods.cameras.adjustment import Rig
from methods.hull import HullSettings, hull_of
from tests.spheres import icosphere

PER_M, SIZE, RADIUS = 150.0, 240, 0.5
CENTRE = np.array([0.1, -0.05, 0.2])


def camera(yaw_deg: float = 0.0) -> Camera:
    yaw = np.radians(yaw_deg)
    eye = 3.0 * np.array([np.sin(yaw), 0.0, np.cos(yaw)])
    K = np.array([[PER_M, 0, SIZE / 2], [0, PER_M, SIZE / 2], [0, 0, 1]])
    return Camera(K, look_at(eye, np.zeros(3)), SIZE, SIZE, "orthographic")


def test_a_known_point_lands_on_a_known_pixel_at_every_depth() -> None:
    pixels, depth = camera().project([[0.1, -0.2, 1.0], [0.1, -0.2, -1.0], [0, 0, 4.0]])

    np.testing.assert_allclose(pixels[:2], [[135, 150], [135, 150]])
    assert np.isnan(pixels[2]).all()  # behind the plane
    np.testing.assert_allclose(depth, [2, 4, -1])


def test_rays_are_parallel_and_start_in_the_plane_of_the_origin() -> None:
    seen = camera(30.0)
    pixels = np.array([[10.0, 20.0], [150.0, 60.0]])

    np.testing.assert_allclose(seen.ray_directions(pixels), [seen.forward, seen.forward])
    points = seen.unproject(pixels, [1.0, 2.5])
    origins = seen.ray_origins(pixels)
    np.testing.assert_allclose(points - origins, np.outer([1.0, 2.5], seen.forward), atol=1e-12)
    np.testing.assert_allclose(seen.eye_of(points), origins, atol=1e-12)
    np.testing.assert_allclose(seen.project(points)[0], pixels)
    homogeneous = np.column_stack([points, np.ones(2)]) @ seen.projection.T
    np.testing.assert_allclose(homogeneous, np.column_stack([pixels, np.ones(2)]), atol=1e-12)


def test_crops_sizes_turns_and_frames_keep_the_kind_and_the_points() -> None:
    points = np.array([[0.1, 0.2, 0.3], [-0.2, 0.1, -0.1]])
    pixels = camera().project(points)[0]
    fine = camera().cropped(10, 20, 100, 120).resized(200, 240)

    np.testing.assert_allclose(fine.project(points)[0], 2 * (pixels - (10, 20)))
    moved = np.eye(4)
    moved[:3, 3] = 1, 2, 3
    np.testing.assert_allclose(camera().in_frame(moved).project(points + moved[:3, 3])[0], pixels)
    larger = Similarity(2.0, np.eye(3), moved[:3, 3])
    seen = larger.camera(camera())
    np.testing.assert_allclose(seen.project(larger.points(points))[0], pixels)
    assert {fine.kind, camera().turned(np.eye(3)).kind} == {"orthographic"}


def test_weak_perspective_is_exact_at_its_depth() -> None:
    seen = RingRig().cameras(180, 320)[1]
    middle = seen.unproject([[40.0, 50.0], [170.0, 300.0]], [2.5, 2.5])
    weak = seen.weak_perspective(2.5)

    np.testing.assert_allclose(weak.project(middle)[0], seen.project(middle)[0])
    assert weak.is_orthographic
    assert weak.weak_perspective(1.0) is weak


def test_it_goes_through_json_and_old_files_are_perspective() -> None:
    values = json.loads(json.dumps(camera().to_dict()))

    assert values["kind"] == "orthographic"
    assert Camera.from_dict(values).is_orthographic
    plain = RingRig().cameras(90, 160)[0].to_dict()
    assert "kind" not in plain  # what was hashed stays as it was
    assert Camera.from_dict(plain).kind == "perspective"
    with pytest.raises(DataError, match="not a kind of camera"):
        Camera.from_dict({**plain, "kind": "fisheye"})


def test_a_sphere_has_its_silhouette_depth_and_normals() -> None:
    caster, seen = Raycaster(icosphere(RADIUS, 6, CENTRE)), camera(40.0)
    x, y = (seen.pixel_centres() - seen.project(CENTRE[None])[0][0]).transpose(2, 0, 1) / PER_M
    inside = np.hypot(x, y) < RADIUS - 1.0 / PER_M
    toward = np.sqrt(np.where(inside, RADIUS**2 - x**2 - y**2, 0.0))
    middle = seen.project(CENTRE[None])[1][0]

    mask = caster.mask(seen)
    assert mask.sum() == pytest.approx(np.pi * (RADIUS * PER_M) ** 2, rel=2e-3)
    assert mask[inside].all()
    assert not mask[np.hypot(x, y) > RADIUS].any()
    near, far = (caster.cast(seen, side) for side in ("near", "far"))
    np.testing.assert_allclose(near.depth[inside], (middle - toward)[inside], atol=1.5e-3)
    np.testing.assert_allclose(far.depth[inside], (middle + toward)[inside], atol=1.5e-3)
    normals = np.stack([x, -y, toward], axis=2) / RADIUS
    cosine = (caster.normals_at(near, seen) * normals).sum(axis=2)[inside]
    assert np.degrees(np.arccos(cosine.min().clip(-1, 1))) < 2.0
    # The nearer half, up to the outline, is what it sees.
    points = icosphere(RADIUS, 4, CENTRE).vertices
    facing = (CENTRE - points) @ seen.forward / RADIUS
    shown = caster.visible(points, seen, tolerance_m=2e-3)
    assert shown[facing > 0.1].all()
    assert not shown[facing < -0.1].any()


def test_silhouettes_tell_place_and_hull() -> None:
    caster = Raycaster(icosphere(RADIUS, 6, CENTRE))
    outlines = [Outline(each, caster.coverage(each)) for each in map(camera, range(0, 360, 45))]
    place = place_of(outlines)

    np.testing.assert_allclose(place.centre, CENTRE, atol=1e-2)
    assert place.half_height_m == pytest.approx(RADIUS, abs=5e-3)
    assert place.depth_is_known
    # One, and one from the other side, show the same at any depth.
    for few in (outlines[:1], outlines[:5:4]):
        alone = place_of(few)
        assert not alone.depth_is_known
        assert alone.half_height_m == pytest.approx(RADIUS, abs=5e-3)
    assert place_of(outlines[:3:2]).depth_is_known
    hull = hull_of(outlines, HullSettings(voxel_m=0.01))
    across = np.linalg.norm(hull.vertices - CENTRE, axis=1)
    # Eight sides touch the sphere; the corners between them stand off.
    assert across.min() == pytest.approx(RADIUS, abs=6e-3)
    assert across.max() < 1.12 * RADIUS


def test_files_that_have_no_such_camera_refuse_it(tmp_path: Path) -> None:
    both = [camera(), RingRig().cameras(90, 160)[0]]
    for write, names in (
        (write_colmap, [["a.png"]]),
        (write_colmap_binary, [["a.png"]]),
        (write_published, []),
    ):
        with pytest.raises(DataError, match="camera 0 cannot be written in .* form") as error:
            write(tmp_path / "x", [camera()], *names)  # type: ignore[operator]
        assert "nerfstudio" in str(error.value)
    write_transforms_json(tmp_path / "t.json", [camera()], ["a.png"])
    assert json.loads((tmp_path / "t.json").read_text())["camera_model"] == "ORTHOPHOTO"
    with pytest.raises(DataError, match="cannot be in one file with perspective"):
        write_transforms_json(tmp_path / "t.json", both, ["a.png", "b.png"])
    with pytest.raises(DataError, match="camera 1 cannot be refined"):
        Rig.of(both[::-1])
