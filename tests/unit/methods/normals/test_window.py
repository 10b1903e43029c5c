"""Windows around a subject: multiples of 32, room on every side, and the way back."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from methods.normals.onnx_estimator import MARGIN_PX, mask_window, whole_window


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
    size = (mask.shape[1], mask.shape[0])
    for window in (mask_window(mask), whole_window(size)):
        part = window.cut(picture, 7.0)
        assert part.shape == (window.height, window.width, 2)
        np.testing.assert_array_equal(window.put_back(part, size), picture)
