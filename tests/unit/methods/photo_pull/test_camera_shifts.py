"""Photos of a textured sphere whose cameras are off by known pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.core.arrays import Floats
from harness.core.errors import HarnessError
from harness.core.mesh import Mesh
from methods.photo_pull import camera_shifts as module
from methods.photo_pull.camera_shifts import Shifts, camera_shifts
from methods.stereo.settings import CameraSettings, NarrowSettings
from methods.stereo.views import StereoView
from tests.unit.methods.photo_pull.conftest import without_common_move
from tests.unit.methods.stereo.conftest import CAMERAS, grain, photographs, plain

NARROW = NarrowSettings()
SETTINGS = CameraSettings(points=3000)


def off_by(views: list[StereoView], shifts: Floats) -> list[StereoView]:
    """The photos with cameras that have everything so many pixels too far to the left and top."""
    return [
        replace(view, camera=view.camera.shifted(*-by))
        for view, by in zip(views, shifts, strict=True)
    ]


def drawn(pixels: float, seed: int) -> Floats:
    return np.random.default_rng(seed).normal(0.0, pixels, (len(CAMERAS), 2))


def apart(found: Floats, true: Floats, mesh: Mesh) -> float:
    """Root mean square of what no common move of the subject explains, pixels."""
    left = without_common_move(found - true, mesh.vertices, CAMERAS)
    return float(np.sqrt((left**2).sum(axis=1).mean()))


def test_exact_cameras_are_left_as_they_are(sphere, textured):
    found = camera_shifts(sphere, textured, NARROW, SETTINGS)

    assert not found.is_used
    assert np.abs(found.pixels).max() < 0.05
    np.testing.assert_array_equal(found.used_px, 0.0)
    assert found.details()["corrected"] is False


@pytest.mark.nightly
@pytest.mark.parametrize(("pixels", "seed"), [(0.3, 1), (1.0, 2)])
def test_known_shifts_are_found(sphere, textured, pixels, seed):
    true = drawn(pixels, seed)
    # Not the true surface: the fused one is off by millimetres.
    start = Mesh(sphere.vertices * 0.98, sphere.faces)
    found = camera_shifts(start, off_by(textured, true), NARROW, SETTINGS)

    assert found.is_used
    assert apart(found.used_px, true, sphere) < 0.2 * pixels
    assert found.after_m < 0.4 * found.before_m
    said = found.details()
    assert said["corrected"] is True
    assert np.shape(said["shift_px"]) == (8, 2)


@pytest.mark.nightly
def test_noise_is_not_taken_for_shifts(sphere):
    noisy = photographs(sphere, CAMERAS, grain, noise=6.0)
    found = camera_shifts(sphere, noisy, NARROW, SETTINGS)

    assert not found.is_used
    assert np.abs(found.pixels).max() < 0.15


def test_plain_photos_tell_nothing(sphere):
    views = off_by(photographs(sphere, CAMERAS, plain, noise=2.0), drawn(1.0, 3))
    found = camera_shifts(sphere, views, NARROW, SETTINGS)

    assert not found.is_used
    assert found.points == 0
    assert found.details() == {"points": 0, "corrected": False}


def test_views_without_neighbours_tell_nothing(sphere, textured):
    found = camera_shifts(sphere, [textured[0], textured[4]], NARROW, SETTINGS)

    assert not found.is_used
    np.testing.assert_array_equal(found.pixels, np.zeros((2, 2)))


def test_what_is_corrected_is_said_where_a_later_pass_finds_too_little(
    sphere, textured, monkeypatch
):
    answers = iter([Shifts(np.ones((8, 2)), 300, 0.002, 0.0005), None])
    monkeypatch.setattr(module._Asked, "shifts", lambda *_: next(answers))
    found = camera_shifts(sphere, textured, NARROW, SETTINGS)

    assert found.is_used
    assert found.points == 300
    assert found.details()["corrected"] is True


def test_a_limit_that_makes_no_sense_is_refused():
    with pytest.raises(HarnessError, match="least_px"):
        CameraSettings(least_px=-1.0)
