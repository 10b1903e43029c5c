"""Depth maps of solids whose depth is known."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from methods.stereo.patchmatch import StartSurface, depth_map
from methods.stereo.pull import consistent_points
from methods.stereo.settings import MatchSettings, StereoSettings
from methods.stereo.surface import neighbours, stereo_points
from methods.stereo.views import contrast
from tests.unit.methods.stereo.conftest import (
    CAMERAS,
    RADIUS,
    grain,
    photographs,
    plain,
    shaken,
    stripes,
)

SETTINGS = StereoSettings()


def off_sphere_mm(points) -> np.ndarray:
    return 1e3 * np.abs(np.linalg.norm(points.positions, axis=1) - RADIUS)


def slab(front_m: float) -> Mesh:
    """A thin box, 16 cm wide, whose front lies at z = front_m."""
    x, y, z = 0.08, 0.08, 0.01
    signs = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], float)
    vertices = signs * [x, y, z] + [0, 0, front_m - z]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    return Mesh(vertices, np.array(faces), source="slab")


@pytest.mark.parametrize(
    "parallel", [(), (0, 1, 2), (1,)], ids=["perspective", "orthographic", "mixed"]
)
def test_a_plane_is_found_two_centimetres_behind_the_start(parallel):
    cameras = tuple(
        CAMERAS[view].weak_perspective(3.0) if place in parallel else CAMERAS[view]
        for place, view in enumerate((7, 0, 1))
    )
    photos = [contrast(v, 1, 6.0) for v in photographs(slab(0.0), cameras, grain)]
    start = StartSurface(slab(0.02))
    found = depth_map(1, photos, (0, 2), start, MatchSettings())
    assert found is not None
    inner = np.zeros_like(found.searched)
    inner[12:-12, 12:-12] = True
    good = found.searched & inner & (found.cost < 0.25)
    assert good.sum() > 0.9 * (found.searched & inner).sum()
    error_mm = 1e3 * np.abs(found.depth[good] - 3.0)
    assert np.median(error_mm) < 0.2
    assert np.quantile(error_mm, 0.9) < 0.5
    toward = found.normal[good] @ [0, 0, -1]
    assert np.degrees(np.arccos(np.clip(np.median(toward), -1, 1))) < 3


@pytest.mark.nightly
def test_points_lie_on_the_textured_sphere(textured, around):
    points = stereo_points(textured, around, SETTINGS)
    error_mm = off_sphere_mm(points)
    assert len(points) > 10_000
    # A flat window of 2 cm on this sphere leaves it by up to 0.3 mm.
    assert np.median(error_mm) < 0.5
    assert np.quantile(error_mm, 0.95) < 1.5
    outward = (points.normals * points.positions).sum(axis=1) / np.linalg.norm(
        points.positions, axis=1
    )
    assert np.degrees(np.arccos(np.quantile(outward, 0.1))) < 12
    assert (points.score > 0.75).all()
    assert set(points.view) == set(range(8))


@pytest.mark.nightly
@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_a_plain_sphere_gives_no_points(sphere, around, noise):
    cameras = tuple(CAMERAS[view] for view in (7, 0, 1))
    points = stereo_points(photographs(sphere, cameras, plain, noise), around, SETTINGS)
    assert len(points) < 20


@pytest.mark.nightly
def test_stripes_along_the_line_between_the_cameras_tell_no_depth(sphere, around):
    cameras = tuple(CAMERAS[view] for view in (7, 0, 1))
    views = photographs(sphere, cameras, stripes((0, 1, 0), 0.02))
    points = stereo_points(views, around, SETTINGS)
    assert len(points) < 300 or np.quantile(off_sphere_mm(points), 0.9) < 3.0


@pytest.mark.nightly
@pytest.mark.parametrize("wave_m", [0.016, 0.03])
def test_upright_stripes_are_not_locked_to_a_wrong_period(sphere, around, wave_m):
    cameras = tuple(CAMERAS[view] for view in (7, 0, 1))
    views = photographs(sphere, cameras, stripes((0.8, 0.3, 0.52), wave_m))
    points = stereo_points(views, around, SETTINGS)
    assert (off_sphere_mm(points) < 3.0).mean() > 0.9


@pytest.mark.nightly
def test_noise_and_wrong_cameras_leave_fewer_points(textured, sphere, around):
    cameras = tuple(CAMERAS[view] for view in (0, 1))
    exact = [textured[view] for view in (0, 1)]
    counts = [len(stereo_points(exact, around, SETTINGS))]
    for noise in (8.0, 40.0):
        noisy = photographs(sphere, cameras, grain, noise)
        counts.append(len(stereo_points(noisy, around, SETTINGS)))
    assert counts[0] > counts[1] > counts[2]
    wrong = shaken(tuple(view.camera for view in exact), 1.5, 3)
    off = [
        type(view)(camera, view.grey, view.coverage)
        for view, camera in zip(exact, wrong, strict=True)
    ]
    assert len(stereo_points(off, around, SETTINGS)) < counts[0]


def test_equal_photos_give_equal_points(sphere, around):
    cameras = tuple(CAMERAS[view] for view in (0, 1))
    views = photographs(sphere, cameras, grain)
    first, second = (stereo_points(views, around, SETTINGS) for _ in range(2))
    np.testing.assert_array_equal(first.positions, second.positions)
    np.testing.assert_array_equal(first.score, second.score)
    assert len(first) > 1000


def test_no_map_gives_no_point():
    assert len(consistent_points({}, SETTINGS.keep, 0.002)) == 0


def test_neighbours_are_the_next_views_on_either_side():
    found = neighbours(RingRig(views=8).cameras(90, 160), np.zeros(3))
    assert [set(each) for each in found] == [{(v - 1) % 8, (v + 1) % 8} for v in range(8)]


@pytest.mark.parametrize(("views", "steps"), [(4, 0), (6, 1), (12, 1), (16, 2), (32, 3)])
def test_neighbours_stay_at_an_angle_that_tells_depth(views, steps):
    found = neighbours(RingRig(views=views).cameras(90, 160), np.zeros(3))
    for view, others in enumerate(found):
        assert {min((o - view) % views, (view - o) % views) for o in others} <= {steps}
        assert len(others) == (2 if steps else 0)
