"""Signed distances to outlines, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from harness.core.errors import MethodError
from methods.closed.surfaces import signed_outline

FOCAL, DISTANCE = 400.0, 2.0


@pytest.fixture
def camera() -> Camera:
    K = np.array([[FOCAL, 0, 160], [0, FOCAL, 120], [0, 0, 1]])
    return Camera(K, look_at((0, 0, DISTANCE), (0, 0, 0)), 320, 240)


def disc(camera: Camera, radius_px: float) -> np.ndarray:
    """Coverage of a disc around the picture's middle, exact to a sixteenth of a pixel's side."""
    fine = camera.resized(16 * camera.width, 16 * camera.height).pixel_centres() / 16
    inside = np.hypot(fine[..., 0] - 160, fine[..., 1] - 120) < radius_px
    return inside.reshape(240, 16, 320, 16).mean(axis=(1, 3))


def test_distances_are_those_to_a_disc(camera):
    outline = signed_outline(camera, disc(camera, 50.0))
    x = np.linspace(-0.4, 0.4, 41)
    points = np.stack([x, 0.3 * x, np.zeros_like(x)], axis=1)
    expected = 50.0 - np.hypot(points[:, 0], points[:, 1]) * FOCAL / DISTANCE
    found = outline.distances_px(points)
    # Exact within the pixels of the outline; elsewhere measured from the middles of pixels. The
    # middle of the disc is as far from the outline as its four pixels around are.
    np.testing.assert_allclose(found, expected, atol=1.2)
    assert np.abs(found - expected).mean() < 0.4
    near = np.abs(expected) < 1
    np.testing.assert_allclose(found[near], expected[near], atol=0.3)
    np.testing.assert_allclose(outline.distances_m(points), found * DISTANCE / FOCAL, rtol=1e-6)


def test_the_outline_lies_within_the_pixel(camera):
    """An upright edge that moves by tenths of a pixel moves the outline by as much."""
    for part in np.linspace(0.05, 0.95, 7):
        coverage = np.zeros((240, 320))
        coverage[:, :160] = 1.0
        coverage[:, 160] = part
        outline = signed_outline(camera, coverage)
        edge_m = (160 + part - 160) * DISTANCE / FOCAL
        assert outline.distances_px(np.array([[edge_m, 0, 0]]))[0] == pytest.approx(0, abs=0.3)


def test_the_distance_grows_inward(camera):
    outline = signed_outline(camera, disc(camera, 50.0))
    turn = np.linspace(0, 2 * np.pi, 13)
    outward = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    points = 0.22 * outward
    cosine = np.einsum("ij,ij->i", outline.inward(points), -outward)
    assert cosine.min() > 0.95
    np.testing.assert_allclose(outline.slopes(points, outward), -1.0, atol=0.1)


def test_the_frame_is_no_outline(camera):
    coverage = np.zeros((240, 320))
    coverage[60:, 100:200] = 1.0  # cut below
    outline = signed_outline(camera, coverage)
    bottom = np.array([[(150 - 160) * DISTANCE / FOCAL, -120 * DISTANCE / FOCAL, 0.0]])
    assert outline.distances_px(bottom)[0] == pytest.approx(50, abs=1)
    assert outline.distances_px(bottom - [0, 0.5, 0])[0] == pytest.approx(50, abs=1)


def test_a_view_that_is_all_subject_carves_nothing(camera):
    outline = signed_outline(camera, np.ones((240, 320)))
    assert (outline.distances_m(np.random.default_rng(0).uniform(-1, 1, (50, 3))) > 0).all()


def test_points_behind_the_camera_are_no_reason_to_fail(camera):
    outline = signed_outline(camera, disc(camera, 50.0))
    assert np.isfinite(outline.distances_m(np.array([[0.0, 0.0, 5.0], [0, 0, DISTANCE]]))).all()


def test_bad_masks_are_refused(camera):
    with pytest.raises(MethodError, match="shows no subject"):
        signed_outline(camera, np.zeros((240, 320)))
    with pytest.raises(MethodError, match="not of its camera's size"):
        signed_outline(camera, np.ones((320, 240)))
