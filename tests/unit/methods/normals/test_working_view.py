"""The square around the subject: its camera, its colours, its mask."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.artifacts import image_name
from harness.core.errors import MethodError
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from methods.normals import working_view


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.3, 0.55, 0.0)])
def test_picture_and_camera_agree(centre, sphere, photograph):
    mesh = sphere(0.3, centre)
    view = working_view(photograph(mesh), 0, 64)
    assert view.mask.shape == (64, 64) == (view.camera.height, view.camera.width)
    truth = Raycaster(mesh).coverage(view.camera) >= 0.5
    assert (truth & view.mask).sum() / (truth | view.mask).sum() > 0.98
    columns = np.flatnonzero(view.mask.any(axis=0))
    assert 0.85 * 64 < np.ptp(columns) + 1 < 0.95 * 64


def test_colours_stay_in_place_on_black(sphere, photograph):
    view = working_view(photograph(sphere(0.3)), 0, 64)
    assert (view.rgb[~view.mask] == 0).all()
    red, _, blue = view.rgb[32, 20]
    assert (red, blue) == (1.0, 0.0)
    red, _, blue = view.rgb[32, 44]
    assert (red, blue) == (0.0, 1.0)


def test_a_small_picture_is_not_enlarged(sphere, photograph):
    capture = photograph(sphere(0.1))
    assert working_view(capture, 0, 512).camera.width < 100


@pytest.mark.parametrize("radius", [0.3, 0.1])
def test_an_estimator_gets_the_size_that_it_asks_for(radius, sphere, photograph):
    capture = photograph(sphere(radius))
    view = working_view(capture, 0, 64, 96)
    assert view.asked.mask.shape == (96, 96) == (view.asked.camera.height, view.asked.camera.width)
    assert view.asked.asked is None
    # The same square: both cameras see a point at the same place.
    point = np.array([[0.05, 0.02, 0.0]])
    np.testing.assert_allclose(
        view.asked.camera.project(point)[0] / 96, view.camera.project(point)[0] / view.camera.width
    )
    assert abs(view.asked.mask.mean() - view.mask.mean()) < 0.02
    for side in (0, view.camera.width):
        assert working_view(capture, 0, 64, side).asked is None


def test_an_empty_view_is_refused(sphere, photograph):
    capture = photograph(sphere(0.3))
    save_png(capture.directory / image_name(1), np.zeros((480, 270, 4), np.uint8))
    with pytest.raises(MethodError, match="view 1 of ball shows no subject"):
        working_view(capture, 1, 64)
