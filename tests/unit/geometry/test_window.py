"""Rectangles of pixels: where they lie, what they cut out, and what they do to a camera."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.core.rigs import RingRig
from harness.geometry.window import Window, is_cut

CAMERA = RingRig().cameras(108, 192)[0]
SIDES, CORNERS = st.integers(1, 12), st.integers(-15, 15)
WINDOWS = st.builds(Window, CORNERS, CORNERS, SIDES, SIDES)


def test_the_box_of_a_mask():
    mask = np.zeros((9, 12), bool)
    mask[2, 3] = mask[6, 10] = True
    box = Window.around(mask)
    assert box == Window(left=3, top=2, width=8, height=5)
    assert (box.right, box.bottom, box.size, box.longer_side) == (11, 7, (8, 5), 8)
    assert mask[box.slices].shape == (5, 8)
    assert mask[box.slices].sum() == 2


@given(WINDOWS, SIDES, SIDES)
def test_a_window_is_cut_and_put_back_pixel_by_pixel(window, width, height):
    picture = np.arange(1, 1 + width * height * 2, dtype=np.int16).reshape(height, width, 2)
    part = window.cut(picture, -7)
    assert part.dtype == picture.dtype
    assert part.shape == (window.height, window.width, 2)
    kept = np.zeros_like(picture)
    for row, column in np.ndindex(window.height, window.width):
        y, x = row + window.top, column + window.left
        inside = 0 <= y < height and 0 <= x < width
        assert (part[row, column] == (picture[y, x] if inside else -7)).all()
        if inside:
            kept[y, x] = picture[y, x]
    np.testing.assert_array_equal(window.put_back(part, (width, height)), kept)


def test_a_cut_is_a_copy():
    picture = np.zeros((4, 4))
    Window(0, 0, 2, 2).cut(picture)[:] = 1.0
    assert not picture.any()


@given(WINDOWS, st.integers(1, 60), st.integers(1, 60))
def test_a_change_of_size_keeps_the_middle_and_puts_the_odd_pixel_where_it_is_said(
    window, width, height
):
    first = window.about_its_middle(width, height)
    last = window.about_its_middle(width, height, odd_pixel="last")
    assert first.size == last.size == (width, height)
    for a, b, length, ends in (
        (first.left, last.left, width, window.left + window.right),
        (first.top, last.top, height, window.top + window.bottom),
    ):
        # Twice the middle of each, as far off the window's own as an odd pixel makes it.
        odd = (length - ends) % 2
        assert 2 * a + length - ends == -odd
        assert 2 * b + length - ends == odd


def test_squares_and_margins():
    box = Window(10, 20, 31, 80)
    assert box.grown(5) == Window(5, 15, 41, 90)
    # 80 / 0.9 is 88.9; of 58 and 9 columns and rows that are added, the top gets five of nine.
    assert box.square(0.9) == Window(10 - 29, 20 - 5, 89, 89)


def test_the_camera_of_a_window_sees_what_is_cut_out():
    window = Window(-10, 25, 110, 120)
    points = np.random.default_rng(0).uniform(-0.4, 0.4, (20, 3))
    pixels, _ = CAMERA.project(points)
    cropped = window.camera(CAMERA)
    assert cropped.size == window.size
    np.testing.assert_allclose(cropped.project(points)[0], pixels - (-10, 25), atol=1e-9)
    half = window.camera(CAMERA, (55, 60))
    np.testing.assert_allclose(half.project(points)[0], (pixels - (-10, 25)) / 2, atol=1e-9)
    assert Window.of_crop(CAMERA, half) == window


def test_points_in_the_frame_across_it_and_behind_the_camera():
    inside = np.array([[-0.2, -0.1, 0.0], [0.1, 0.3, 0.0]])
    window = Window.around_points(inside, CAMERA, margin=0)
    pixels, _ = CAMERA.project(inside)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    assert (window.left, window.top) == tuple(np.floor(low))
    assert (window.right, window.bottom) == tuple(np.ceil(high))
    assert Window.around_points(inside, CAMERA) == window.grown(1)
    assert not is_cut(inside, CAMERA)
    across = inside + np.array([CAMERA.width / CAMERA.K[0, 0] * 3.0 / 2, 0.0, 0.0])
    assert is_cut(across, CAMERA)
    assert Window.around_points(across, CAMERA).right == CAMERA.width
    beside = Window.around_points(inside + np.array([9.0, 0.0, 0.0]), CAMERA)
    assert beside.is_empty
    assert beside.size == (0, 0)
    behind = np.array([CAMERA.position - CAMERA.forward])
    assert is_cut(behind, CAMERA)
    assert Window.around_points(behind, CAMERA) == Window.whole(CAMERA.size)


@pytest.mark.parametrize("margin", [0, 1, 7])
def test_a_window_of_points_stays_in_the_picture(margin):
    corners = CAMERA.unproject([(0.0, 0.0), CAMERA.size], [3.0, 3.0])
    window = Window.around_points(0.999999 * corners, CAMERA, margin=margin)
    assert window == Window.whole(CAMERA.size)
