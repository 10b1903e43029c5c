"""The part of a picture that a network works on, and the way back.

Networks halve their pictures up to five times, so a window's sides are multiples of 32. A network
that is trained on windows around the subject sees the same whether the subject stands in the middle
of the picture or at its border, and does not work on what is empty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats

__all__ = ["MARGIN_PX", "Window", "mask_window", "whole_window"]


#: Least number of pixels between the subject and the window's border.
MARGIN_PX = 16
_MULTIPLE = 32


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of pixels; it may reach outside the picture on every side.

    Attributes:
        top, left: Row and column of its first pixel in the picture, possibly negative.
        height, width: Its size, multiples of 32.
    """

    top: int
    left: int
    height: int
    width: int

    def cut(self, picture: Floats, outside: float = 0.0) -> Floats:
        """The window (height, width, C) of a picture (H, W, C); ``outside`` beyond its border."""
        there, here = self._overlap(picture.shape[0], picture.shape[1])
        cut = np.full((self.height, self.width, picture.shape[2]), outside)
        cut[here] = picture[there]
        return cut

    def put_back(self, part: Floats, size: tuple[int, int]) -> Floats:
        """A picture (H, W, C) of ``size`` (H, W) that is zero but for the window (h, w, C)."""
        there, here = self._overlap(*size)
        picture = np.zeros((*size, part.shape[2]))
        picture[there] = part[here]
        return picture

    def _overlap(self, height: int, width: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """Where picture and window meet, in the picture and in the window."""
        pairs = [
            (max(start, 0), min(start + length, size), start)
            for start, length, size in (
                (self.top, self.height, height),
                (self.left, self.width, width),
            )
        ]
        rows, columns = (slice(first, last) for first, last, _ in pairs)
        own_rows, own_columns = (slice(first - at, last - at) for first, last, at in pairs)
        return (rows, columns), (own_rows, own_columns)


def mask_window(mask: NDArray[np.bool_]) -> Window:
    """The window around a mask (H, W) that is true somewhere, ``MARGIN_PX`` free on every side.

    What rounding adds is shared between both sides; the right and lower get an odd pixel more.
    """
    top, height = _span(np.flatnonzero(mask.any(axis=1)))
    left, width = _span(np.flatnonzero(mask.any(axis=0)))
    return Window(top, left, height, width)


def whole_window(size: tuple[int, int]) -> Window:
    """The window of a whole picture (H, W), enlarged to the right and below."""
    return Window(0, 0, _rounded_up(size[0]), _rounded_up(size[1]))


def _span(lines: NDArray[np.intp]) -> tuple[int, int]:
    """First line and length of the window around rows or columns, which are sorted."""
    first, last = int(lines[0]) - MARGIN_PX, int(lines[-1]) + 1 + MARGIN_PX
    length = _rounded_up(last - first)
    return first - (length - (last - first)) // 2, length


def _rounded_up(length: int) -> int:
    return length + -length % _MULTIPLE
