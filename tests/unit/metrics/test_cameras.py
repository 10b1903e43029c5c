"""Camera errors of known turns and shifts; what a similarity takes away is no error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.core.camera import Camera
from harness.core.metric_catalog import METRICS
from harness.core.rigs import RingRig
from harness.geometry.similarity import Similarity
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


def test_a_wrong_focal_length_is_seen_in_pixels_alone():
    wide = [replace(camera, K=np.diag([1.05, 1.05, 1]) @ camera.K) for camera in KNOWN]
    middle = np.array([[1, 0, -0.05 * 54], [0, 1, -0.05 * 96], [0, 0, 1.0]])
    wide = [replace(camera, K=middle @ camera.K) for camera in wide]
    errors = {name: each.value for name, each in camera_errors(wide, KNOWN, POINTS).items()}
    assert errors["camera_rotation"] == pytest.approx(0, abs=1e-5)
    away = [camera.project(POINTS)[0] - [54, 96] for camera in KNOWN]
    expected = 0.05 * np.sqrt((np.concatenate(away) ** 2).sum(axis=1).mean())
    assert errors["camera_reprojection"] == pytest.approx(expected, rel=1e-6)
