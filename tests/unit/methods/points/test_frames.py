"""Pixels of a photo through resize, padding and cropping, with their camera."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.results import PhotoFrame
from harness.core.rigs import RingRig
from methods.points.cloud import coverage_in

#: Photo, and what it is resized to, its shift and the picture's size.
FRAMES = [
    PhotoFrame((1080, 1920), (294, 518), (112, 0), (518, 518)),
    PhotoFrame((1080, 1920), (518, 924), (0, -203), (518, 518)),
    PhotoFrame((1920, 1080), (518, 294), (0, 112), (518, 518)),
    PhotoFrame.whole((270, 480), (294, 518)),
]


@pytest.mark.parametrize("frame", FRAMES)
def test_the_camera_goes_with_the_pixels(frame):
    """A point is seen at scale * x + shift: edges at whole numbers, both scales by themselves."""
    camera = RingRig().cameras(*frame.photo)[1]
    points = np.random.default_rng(0).uniform(-0.8, 0.8, (50, 3))
    before, depth = camera.project(points)
    after, same = frame.camera(camera).project(points)
    scale = np.array(frame.resized) / frame.photo
    np.testing.assert_allclose(after, before * scale + frame.shift, atol=1e-9)
    np.testing.assert_allclose(same, depth)


def test_a_camera_of_another_photo_is_refused():
    with pytest.raises(DataError, match="does not fit its photo"):
        FRAMES[0].camera(RingRig().cameras(540, 960)[0])


def test_coverage_follows_and_is_zero_in_the_padding():
    frame = PhotoFrame((60, 100), (308, 518), (105, 0), (518, 518))
    coverage = coverage_in(frame, np.ones((100, 60)))
    assert coverage.shape == (518, 518)
    assert coverage[:, 105:-105].min() > 0.999
    assert coverage[:, :105].max() == 0
    cropped = coverage_in(FRAMES[1], np.ones((1920, 1080)))
    assert cropped.shape == (518, 518)
    assert cropped.min() > 0.999
