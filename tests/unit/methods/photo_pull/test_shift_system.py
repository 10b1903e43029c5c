"""Shifts of photos follow from contradictions by closed forms: nothing is matched here."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.rigs import RingRig
from methods.photo_pull.camera_shifts import (
    Across,
    Contradictions,
    _jacobians,  # pyright: ignore[reportPrivateUsage]
    across_direction,
    solved_shifts,
)
from tests.unit.methods.photo_pull.conftest import without_common_move

CAMERAS = RingRig(views=8).cameras(1080, 1920)
PAIRS = [(view, (view + 1) % 8) for view in range(8)]
RADIUS = 0.3


def on_a_sphere(count: int, seed: int = 0) -> Floats:
    """(N, 3) unit directions around the equator, where every pair sees something."""
    rng = np.random.default_rng(seed)
    yaw, height = rng.uniform(0, 2 * np.pi, count), rng.uniform(-0.7, 0.7, count)
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.sin(yaw), height, flat * np.cos(yaw)], axis=1)


def matched_offset(
    point: Floats, normal: Floats, two: tuple[Camera, Camera], off: Floats
) -> tuple[float, float]:
    """Where two photos that lie ``off`` (2, 2) pixels beside their cameras match best, in metres
    along the normal, and by how many pixels they then miss each other in the second photo.

    By definition: the point of the plane whose true pictures are the pixels looked at, for either
    photo, found by finite differences.
    """
    tangent = np.cross(normal, [0.0, 1.0, 0.0])
    tangent /= np.linalg.norm(tangent)
    plane = np.stack([tangent, np.cross(normal, tangent)], axis=1)
    step = 1e-5

    def change(camera: Camera, direction: Floats) -> Floats:
        ahead, behind = camera.project(
            np.stack([point + step * direction, point - step * direction])
        )[0]
        return (ahead - behind) / (2 * step)

    shown, moving, seen = [], [], []
    for camera, shift in zip(two, off, strict=True):
        picture = np.stack([change(camera, axis) for axis in plane.T], axis=1)
        shown.append(np.linalg.solve(picture, -shift))
        moving.append(np.linalg.solve(picture, change(camera, normal)))
        seen.append(picture)
    parallax, apart = moving[0] - moving[1], shown[0] - shown[1]
    offset = -float(parallax @ apart) / float(parallax @ parallax)
    return offset, float(np.linalg.norm(seen[1] @ (apart + offset * parallax)))


@pytest.mark.parametrize("camera", [CAMERAS[1], CAMERAS[1].weak_perspective(3.0)])
def test_jacobians_are_finite_differences(camera: Camera) -> None:
    points, step = RADIUS * on_a_sphere(20), 1e-5
    found = _jacobians(camera, points)

    for axis, direction in enumerate(step * np.eye(3)):
        ahead, behind = (camera.project(points + sign * direction)[0] for sign in (1, -1))
        np.testing.assert_allclose(found[..., axis], (ahead - behind) / (2 * step), atol=1e-3)


def contradictions(points: Floats, normals: Floats, shifts: Floats) -> Contradictions:
    """What the two pairs around each point's best view say."""
    facing = np.stack(
        [normals @ (c.position / np.linalg.norm(c.position)) for c in CAMERAS], axis=1
    )
    best = facing.argmax(axis=1)
    pair = np.stack([best, (best - 1) % 8], axis=1)
    offsets = np.array(
        [
            [
                matched_offset(
                    point,
                    normal,
                    tuple(CAMERAS[v] for v in PAIRS[number]),
                    shifts[list(PAIRS[number])],
                )[0]
                for number in numbers
            ]
            for point, normal, numbers in zip(points, normals, pair, strict=True)
        ]
    )
    return Contradictions(points, normals, pair, offsets, np.ones(len(points)))


@pytest.mark.parametrize("pixels", [0.3, 1.0, 2.0])
def test_shifts_sideways_are_found(pixels):
    normals = on_a_sphere(1500)
    shifts = np.zeros((8, 2))
    shifts[:, 0] = pixels * np.random.default_rng(1).normal(size=8)
    told = contradictions(RADIUS * normals, normals, shifts)
    found = solved_shifts(CAMERAS, PAIRS, told, [])

    wanted = without_common_move(shifts, RADIUS * normals, CAMERAS)
    np.testing.assert_allclose(
        without_common_move(found.pixels, RADIUS * normals, CAMERAS)[:, 0],
        wanted[:, 0],
        atol=0.15 * pixels,
    )
    assert found.after_m < 0.15 * found.before_m


def test_shifts_up_and_down_follow_from_what_moving_across_says():
    normals = on_a_sphere(400)
    points = RADIUS * normals
    shifts = np.zeros((8, 2))
    shifts[:, 1] = np.random.default_rng(2).normal(size=8)
    told = contradictions(points, normals, shifts)
    across = []
    for number, (first, second) in enumerate(PAIRS):
        seen = np.flatnonzero((told.pair == number).any(axis=1))
        # Cameras at one height: a photo's own shift, less the other's.
        pixels = np.full(len(seen), shifts[second, 1] - shifts[first, 1])
        across.append(Across(number, points[seen], normals[seen], pixels))
    found = solved_shifts(CAMERAS, PAIRS, told, across)

    wanted = shifts[:, 1] - shifts[:, 1].mean()
    np.testing.assert_allclose(found.pixels[:, 1] - found.pixels[:, 1].mean(), wanted, atol=0.1)


def test_exact_cameras_stay():
    normals = on_a_sphere(300)
    told = contradictions(RADIUS * normals, normals, np.zeros((8, 2)))
    found = solved_shifts(CAMERAS, PAIRS, told, [])

    np.testing.assert_allclose(found.pixels, 0.0, atol=1e-9)
    assert found.before_m == pytest.approx(0.0, abs=1e-9)


def test_a_tenth_of_outliers_changes_little():
    normals = on_a_sphere(500)
    shifts = np.zeros((8, 2))
    shifts[:, 0] = np.random.default_rng(3).normal(size=8)
    told = contradictions(RADIUS * normals, normals, shifts)
    wild = told.offsets.copy()
    wild[::10, 0] += 0.01
    clean = solved_shifts(CAMERAS, PAIRS, told, [])
    found = solved_shifts(
        CAMERAS,
        PAIRS,
        Contradictions(told.points, told.normals, told.pair, wild, told.weights),
        [],
    )

    np.testing.assert_allclose(found.pixels, clean.pixels, atol=0.15)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 7), st.floats(-0.3, 0.3), st.floats(-0.8, 0.8), st.floats(-0.3, 0.3))
def test_across_the_line_of_a_ray_nothing_of_the_ray_is_seen(view, x, y, z):
    first, second = CAMERAS[view], CAMERAS[(view + 1) % 8]
    point = np.array([x, y, z])
    across = across_direction(first, second, point)
    further = point + 0.01 * (point - first.position)
    along = second.project(further[None])[0][0] - second.project(point[None])[0][0]

    assert np.linalg.norm(across) == pytest.approx(1.0)
    assert across[1] >= 0
    assert abs(across @ along) < 0.02 * np.linalg.norm(along)
