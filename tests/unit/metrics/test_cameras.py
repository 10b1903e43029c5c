"""Camera errors of known turns and shifts; what a similarity takes away is no error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from harness.core.camera import Camera
from harness.core.metric_catalog import METRICS
from harness.core.rigs import RingRig
from harness.geometry.similarity import Similarity, camera_similarity, similarity_of_pictures
from metrics.cameras import camera_errors

KNOWN = RingRig().cameras(108, 192)
POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 3))


def turned(camera: Camera, deg: float, axis: int) -> Camera:
    """About its own centre, by its own axis."""
    c, s = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    a, b = ((axis + k) % 3 for k in (1, 2))
    turn = np.eye(3)
    turn[a, a], turn[a, b], turn[b, a], turn[b, b] = c, -s, s, c
    return camera.turned(turn)


def test_another_world_is_no_error():
    quarter = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    own = Similarity(0.37, quarter, np.array([1.0, -2.0, 0.5]))
    errors = camera_errors([own.camera(camera) for camera in KNOWN], KNOWN, POINTS)
    for name, value in errors.items():
        assert value.unit == METRICS[name].unit
        assert value.value == pytest.approx(1.0 if "auc" in name else 0.0, abs=1e-5)


def test_one_camera_turned_about_its_centre():
    """7 of 28 pairs have its angle; directions of the 7 change where it is the first of a pair."""
    found = [turned(KNOWN[0], 2.0, 2), *KNOWN[1:]]
    errors = {name: each.value for name, each in camera_errors(found, KNOWN, POINTS).items()}
    assert errors["camera_rotation"] == pytest.approx(2.0 * 7 / 28, rel=1e-6)
    # Seven baselines, none along the axis: each direction is off by less than the turn.
    assert 0 < errors["camera_direction"] < 2.0 * 7 / 28
    assert errors["camera_auc_1"] == pytest.approx(21 / 28, abs=1e-9)
    assert errors["camera_auc_3"] == pytest.approx((21 + 7 / 3) / 28, abs=1e-9)
    assert errors["camera_auc_10"] == pytest.approx((21 + 7 * 0.8) / 28, abs=1e-9)


def test_every_camera_turned_about_its_axis_keeps_positions():
    """A roll of all is no turn of the world: opposite cameras are off by twice as much."""
    found = [turned(camera, 1.0, 2) for camera in KNOWN]
    errors = {name: each.value for name, each in camera_errors(found, KNOWN, POINTS).items()}
    # Rolls by 1 degree about axes that are an angle apart leave 2 sin(angle / 2) degrees.
    gaps = np.radians(45) * np.array([1] * 8 + [2] * 8 + [3] * 8 + [4] * 4)
    assert errors["camera_rotation"] == pytest.approx(2 * np.sin(gaps / 2).mean(), rel=1e-3)
    assert errors["camera_position"] == pytest.approx(0.0, abs=1.0)
    assert errors["camera_reprojection"] > 0.1


def longer(camera: Camera, share: float, distance: float = 1.0) -> Camera:
    """With a focal length that is longer by a share, from further away."""
    middle = np.array([camera.width / 2, camera.height / 2])
    K = np.diag([1 + share, 1 + share, 1]) @ camera.K
    K[:2, 2] = middle
    pose = camera.world_to_camera.copy()
    pose[:3, 3] *= distance
    return replace(camera, K=K, world_to_camera=pose)


def test_a_wrong_focal_length_is_seen_in_pixels_alone():
    """Another size makes up for most of it, as in an estimate, which has no other."""
    found = [longer(camera, 0.05) for camera in KNOWN]
    errors = {name: each.value for name, each in camera_errors(found, KNOWN, POINTS).items()}
    assert errors["camera_rotation"] == pytest.approx(0, abs=1e-5)
    assert errors["camera_position"] == pytest.approx(0, abs=1e-5)

    def left(size: float) -> float:
        pairs = zip(found, KNOWN, strict=True)
        off = [a.project(size * POINTS)[0] - b.project(POINTS)[0] for a, b in pairs]
        return float(np.sqrt((np.concatenate(off) ** 2).sum(axis=1).mean()))

    expected = minimize_scalar(left, bounds=(0.9, 1.1), method="bounded").fun
    assert errors["camera_reprojection"] == pytest.approx(expected, rel=0.02)


def test_a_focal_length_and_a_distance_leave_sizes_as_they_are():
    found = [longer(camera, 0.01, 1.01) for camera in KNOWN]
    assert similarity_of_pictures(found, KNOWN).scale == pytest.approx(1.0, abs=3e-4)
    assert camera_similarity(found, KNOWN).similarity.scale == pytest.approx(1 / 1.01, abs=1e-6)


def test_cameras_that_turn_about_what_they_look_at_move_nothing_there():
    """A place that every camera shows in its old pixel stays where it is, by the pictures alone."""
    there = np.array([[0.05, 0.1, -0.05]])
    found = []
    for view, camera in enumerate(KNOWN):
        turn = Rotation.from_rotvec(np.radians(0.3) * np.eye(3)[view % 3]).as_matrix()
        pose = camera.world_to_camera.copy()
        pose[:3, :3] = camera.rotation @ turn
        pose[:3, 3] += camera.rotation @ (there[0] - turn @ there[0])
        found.append(replace(camera, world_to_camera=pose))
    off_m = [
        float(np.linalg.norm(move.points(there) - there))
        for move in (
            similarity_of_pictures(found, KNOWN),
            camera_similarity(found, KNOWN).similarity,
        )
    ]
    assert off_m[0] < 2e-4 < 4e-4 < off_m[1]
