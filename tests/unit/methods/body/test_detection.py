"""Two readings of one picture, the second in the mirror: closed forms, no detector needed."""

from __future__ import annotations

import numpy as np
import pytest

from methods.body.detection import COUNT, MIRRORED, Reading, agreed

WIDTH = 300


@pytest.fixture
def reading() -> Reading:
    random = np.random.default_rng(0)
    pixels = random.uniform(100, 200, (COUNT, 2))
    pixels[0], pixels[-1] = (150, 50), (150, 250)
    return Reading(pixels, random.normal(size=(COUNT, 3)), random.uniform(0.2, 1.0, COUNT))


def test_the_mirror_image_of_a_mirror_image_is_the_picture(reading):
    for first, again in zip(reading, reading.reflected(WIDTH).reflected(WIDTH), strict=True):
        np.testing.assert_allclose(first, again)


def test_a_left_wrist_in_the_mirror_is_a_right_one_as_far_from_the_other_side(reading):
    seen = reading.reflected(WIDTH)
    left, right = 15, 16
    assert MIRRORED[left] == right
    np.testing.assert_allclose(seen.pixels[left], reading.pixels[right] * (-1, 1) + (WIDTH, 0))
    np.testing.assert_allclose(seen.points_camera[left], reading.points_camera[right] * (-1, 1, 1))
    assert seen.confidence[left] == reading.confidence[right]


def test_readings_that_agree_lose_no_trust(reading):
    both = agreed(reading, reading)
    assert both is not None
    for found, expected in zip(both, reading, strict=True):
        np.testing.assert_allclose(found, expected)


def test_a_landmark_a_twentieth_of_the_person_apart_counts_half(reading):
    moved = reading.pixels.copy()
    moved[16] += (10.0, 0.0)  # the person is 200 pixels high
    both = agreed(reading, reading._replace(pixels=moved))
    assert both is not None
    assert both.confidence[16] == pytest.approx(reading.confidence[16] / 2)
    np.testing.assert_allclose(both.pixels[16], reading.pixels[16] + (5.0, 0.0))
    np.testing.assert_allclose(np.delete(both.confidence, 16), np.delete(reading.confidence, 16))


def test_one_reading_without_a_person_leaves_the_other(reading):
    assert agreed(reading, None) is reading
    assert agreed(None, reading) is reading
    assert agreed(None, None) is None
