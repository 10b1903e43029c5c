"""Windows around a subject: multiples of 32, room on every side, and the way back."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from methods.normals.window import MARGIN_PX, Window, mask_window, whole_window


@st.composite
def masks(draw) -> np.ndarray:
    height, width = draw(st.integers(1, 90)), draw(st.integers(1, 90))
    top, left = draw(st.integers(0, height - 1)), draw(st.integers(0, width - 1))
    mask = np.zeros((height, width), bool)
    mask[top : draw(st.integers(top + 1, height)), left : draw(st.integers(left + 1, width))] = True
    return mask


@given(masks())
def test_the_subject_has_room_and_the_size_can_be_halved(mask):
    window = mask_window(mask)
    rows, columns = np.nonzero(mask)
    for lines, first, length in (
        (rows, window.top, window.height),
        (columns, window.left, window.width),
    ):
        before, after = lines.min() - first, first + length - (lines.max() + 1)
        assert length % 32 == 0
        assert MARGIN_PX <= before <= after <= before + 1
        assert before + after < 2 * MARGIN_PX + 32


@given(masks())
def test_there_and_back(mask):
    picture = np.random.default_rng(0).random((*mask.shape, 2)) * mask[..., None]
    for window in (mask_window(mask), whole_window(mask.shape)):
        part = window.cut(picture, 7.0)
        assert part.shape == (window.height, window.width, 2)
        np.testing.assert_array_equal(window.put_back(part, mask.shape), picture)


def test_a_window_beyond_every_border():
    picture = np.arange(6.0).reshape(2, 3, 1)
    window = Window(-1, -2, 4, 7)
    part = window.cut(picture, -1.0)
    np.testing.assert_array_equal(part[1:3, 2:5], picture)
    assert (part == -1.0).sum() == 4 * 7 - 6
    np.testing.assert_array_equal(window.put_back(part, (2, 3)), picture)
