"""Pixels of a photo through resize, padding and cropping, with their camera."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.rigs import RingRig
from methods.points.cloud import Frame, fitted_frame, fitted_picture

#: As worked out by hand: photo, fit, resized, shift, size.
WORKED = [
    ((1080, 1920), "pad", (294, 518), (112, 0), (518, 518)),
    ((1080, 1920), "fit", (294, 518), (0, 0), (294, 518)),
    ((1080, 1920), "crop", (518, 924), (0, -203), (518, 518)),
    ((270, 480), "pad", (294, 518), (112, 0), (518, 518)),
    ((1920, 1080), "pad", (518, 294), (0, 112), (518, 518)),
    ((512, 512), "pad", (518, 518), (0, 0), (518, 518)),
]


@pytest.mark.parametrize(("photo", "fit", "resized", "shift", "size"), WORKED)
def test_worked_examples(photo, fit, resized, shift, size):
    assert fitted_frame(photo, 518, 14, fit) == Frame(photo, resized, shift, size)


def test_cropping_a_portrait_photo_loses_head_and_feet():
    frame = fitted_frame((1080, 1920), 518, 14, "crop")
    assert frame.resized[1] - frame.size[1] == 406


@pytest.mark.parametrize(("photo", "fit", "resized", "shift", "size"), WORKED)
def test_the_camera_goes_with_the_pixels(photo, fit, resized, shift, size):
    """A point is seen at scale * x + shift: edges at whole numbers, both scales by themselves."""
    camera = RingRig().cameras(*photo)[1]
    points = np.random.default_rng(0).uniform(-0.8, 0.8, (50, 3))
    before, depth = camera.project(points)
    after, same = fitted_frame(photo, 518, 14, fit).camera(camera).project(points)
    scale = resized[0] / photo[0], resized[1] / photo[1]
    np.testing.assert_allclose(after, before * scale + shift, atol=1e-9)
    np.testing.assert_allclose(same, depth)


def test_one_scale_for_both_axes_would_be_seen():
    """The two scales of a portrait photo differ by 0.9 %: several pixels at the feet."""
    scale = fitted_frame((1080, 1920), 518, 14, "pad").scale
    assert abs(scale[0] / scale[1] - 1) == pytest.approx(0.009, abs=0.0005)


def test_a_camera_of_another_photo_is_refused():
    frame = fitted_frame((1080, 1920), 518, 14, "pad")
    with pytest.raises(DataError, match="does not fit its photo"):
        frame.camera(RingRig().cameras(540, 960)[0])


def test_coverage_follows_and_is_zero_in_the_padding():
    frame = fitted_frame((60, 100), 518, 14, "pad")
    coverage = frame.coverage(np.ones((100, 60)))
    left = frame.shift[0]
    assert coverage.shape == (518, 518)
    assert coverage[:, left:-left].min() > 0.999
    assert coverage[:, :left].max() == 0


def test_a_plain_picture_stays_plain_and_transparent_pixels_show_the_background():
    rgba = np.zeros((100, 60, 4), np.uint8)
    picture = fitted_picture(rgba, fitted_frame((60, 100), 70, 14, "pad"), 255)
    assert picture.shape == (70, 70, 3)
    assert (picture == 255).all()
