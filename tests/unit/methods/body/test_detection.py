"""Readings of one picture in different light and in the mirror: closed forms, no detector."""

from __future__ import annotations

import numpy as np
import pytest

from harness.geometry.images import composite
from methods.body.photos.detection import COUNT, MIRRORED, Reading, _pictures, combined

WIDTH = 300


@pytest.fixture
def reading() -> Reading:
    random = np.random.default_rng(0)
    pixels = random.uniform(100, 200, (COUNT, 2))
    pixels[0], pixels[-1] = (150, 50), (150, 250)
    return Reading(
        pixels,
        random.normal(size=(COUNT, 3)),
        random.uniform(0.2, 1.0, COUNT),
        np.array([1.0, 0.0]),
    )


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
    assert seen.hands.tolist() == [0.0, 1.0]


def test_readings_that_agree_lose_no_trust(reading):
    both = combined([reading, reading])
    assert both is not None
    for found, expected in zip(both, reading, strict=True):
        np.testing.assert_allclose(found, expected)


def test_a_landmark_a_twentieth_of_the_person_apart_counts_half(reading):
    moved = reading.pixels.copy()
    moved[16] += (10.0, 0.0)  # the person is 200 pixels high
    both = combined([reading, reading._replace(pixels=moved)])
    assert both is not None
    assert both.confidence[16] == pytest.approx(reading.confidence[16] / 2)
    np.testing.assert_allclose(both.pixels[16], reading.pixels[16] + (5.0, 0.0))
    np.testing.assert_allclose(np.delete(both.confidence, 16), np.delete(reading.confidence, 16))


def test_the_mean_of_six_readings_is_trusted_by_their_spread(reading):
    """Five agree, one is moved: the spread is that of two readings 2 sqrt(5) / 6 as far apart."""
    moved = reading.pixels.copy()
    moved[16] += (18.0, 0.0)
    six = combined([reading] * 5 + [reading._replace(pixels=moved)])
    assert six is not None
    apart = 18.0 * 2 * np.sqrt(5) / 6
    trust = 1 / (1 + (apart / (0.05 * 200)) ** 2)
    np.testing.assert_allclose(six.pixels[16], reading.pixels[16] + (3.0, 0.0))
    assert six.confidence[16] == pytest.approx(trust * reading.confidence[16])


def test_a_person_seen_once_is_seen_and_never_seen_is_not(reading):
    once = combined([reading])
    assert once is not None
    for found, expected in zip(once, reading, strict=True):
        np.testing.assert_allclose(found, expected)
    assert combined([]) is None


def test_the_detector_is_shown_the_subject_on_two_greys_and_darker():
    rgba = np.random.default_rng(0).integers(0, 256, (40, 30, 4), dtype=np.uint8)
    rgba[:15, :, 3], rgba[30:, :, 3] = 0, 255
    light, dark = composite(rgba, (0.75,) * 3), composite(rgba, (0.25,) * 3)
    expected = [np.round(255 * each).astype(np.uint8) for each in (light, light**2, dark)]
    np.testing.assert_array_equal(list(_pictures(rgba)), expected)
