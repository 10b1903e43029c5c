"""A rectangle of pixels: found around a subject, cut out of pictures and cameras, put back.

Coordinates are whole pixels of the picture that the window lies in; a window may reach outside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.core.arrays import Mask
from harness.core.camera import Camera

Number = TypeVar("Number", bound=np.generic)


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of whole pixels.

    Attributes:
        left: First column, negative where the window reaches outside.
        top: First row, likewise.
        width: Columns; 0 for a window without pixels.
        height: Rows.
    """

    left: int
    top: int
    width: int
    height: int

    @classmethod
    def whole(cls, size: tuple[int, int]) -> Window:
        """The window of a whole picture of ``size`` (width, height)."""
        return cls(0, 0, *size)

    @classmethod
    def around(cls, mask: Mask) -> Window:
        """The least window that holds a mask (H, W) which is true somewhere."""
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        left, top = int(columns[0]), int(rows[0])
        return cls(left, top, int(columns[-1]) + 1 - left, int(rows[-1]) + 1 - top)

    @classmethod
    def around_points(cls, points_world: ArrayLike, camera: Camera, *, margin: int = 1) -> Window:
        """The least window within the picture that holds the projections of points.

        A triangle mesh projects inside the window of its vertices. When a point is behind the
        camera nothing can be said and the window is the whole picture.

        Args:
            points_world: (N, 3) metres, N >= 1.
            camera: The view.
            margin: Pixels added on each side, against rounding.
        """
        pixels, depth = camera.project(points_world)
        if not (depth > 0).all():
            return cls.whole(camera.size)
        size = np.array(camera.size)
        first = np.clip(np.floor(pixels.min(axis=0)) - margin, 0, size)
        last = np.clip(np.ceil(pixels.max(axis=0)) + margin, first, size)
        width, height = last - first
        if width == 0 or height == 0:
            width = height = 0.0
        return cls(
            math.floor(first[0]), math.floor(first[1]), math.floor(width), math.floor(height)
        )

    @classmethod
    def of_crop(cls, whole: Camera, crop: Camera) -> Window:
        """The window of a camera's picture that another camera, cropped and resized, shows."""
        scale = whole.K[0, 0] / crop.K[0, 0]
        left, top = whole.K[:2, 2] - scale * crop.K[:2, 2]
        width, height = (round(scale * side) for side in crop.size)
        return cls(round(left), round(top), width, height)

    @property
    def right(self) -> int:
        """The column after the last."""
        return self.left + self.width

    @property
    def bottom(self) -> int:
        """The row after the last."""
        return self.top + self.height

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.width, self.height

    @property
    def longer_side(self) -> int:
        """The larger of width and height."""
        return max(self.height, self.width)

    @property
    def is_empty(self) -> bool:
        """Whether the window has no pixels."""
        return self.width == 0 or self.height == 0

    @property
    def slices(self) -> tuple[slice, slice]:
        """Row and column slices of a window inside its picture, for arrays (H, W, ...)."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def grown(self, margin: int) -> Window:
        """The window with so many pixels more on every side."""
        return Window(
            self.left - margin,
            self.top - margin,
            self.width + 2 * margin,
            self.height + 2 * margin,
        )

    def about_its_middle(
        self, width: int, height: int, *, odd_pixel: Literal["first", "last"] = "first"
    ) -> Window:
        """The window of another size about the same middle.

        Args:
            width: Columns.
            height: Rows.
            odd_pixel: Which end gets one pixel more where an odd number is added: the first, left
                and top, or the last, right and bottom.
        """
        added = width - self.width, height - self.height
        before = [-(-n // 2) if odd_pixel == "first" else n // 2 for n in added]
        return Window(self.left - before[0], self.top - before[1], width, height)

    def square(self, fill: float) -> Window:
        """The square about the same middle of which the longer side fills the share ``fill``."""
        side = int(np.ceil(self.longer_side / fill))
        return self.about_its_middle(side, side)

    def camera(self, whole: Camera, size: tuple[int, int] | None = None) -> Camera:
        """The camera of the window of a camera's picture, resampled to ``size`` (width, height)."""
        cropped = whole.cropped(self.left, self.top, self.width, self.height)
        return cropped if size is None else cropped.resized(*size)

    def cut(self, picture: NDArray[Number], outside: float = 0.0) -> NDArray[Number]:
        """The window (height, width, ...) of a picture (H, W, ...); ``outside`` beyond its border.

        A copy, of the picture's own type.
        """
        there, here = self._overlap(picture.shape[0], picture.shape[1])
        shape = (self.height, self.width, *picture.shape[2:])
        cut: NDArray[Any] = np.full(shape, outside, dtype=picture.dtype)
        cut[here] = picture[there]
        return cut

    def put_back(self, part: NDArray[Number], size: tuple[int, int]) -> NDArray[Number]:
        """A picture of ``size`` (width, height), zero but for the window (height, width, ...)."""
        there, here = self._overlap(size[1], size[0])
        picture = np.zeros((size[1], size[0], *part.shape[2:]), dtype=part.dtype)
        picture[there] = part[here]
        return picture

    def _overlap(self, height: int, width: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """Where picture and window meet, in the picture and in the window."""
        rows, own_rows = _meeting(self.top, self.height, height)
        columns, own_columns = _meeting(self.left, self.width, width)
        return (rows, columns), (own_rows, own_columns)


def is_cut(points_world: ArrayLike, camera: Camera) -> bool:
    """Whether points (N, 3), world metres, reach beyond a camera's frame or behind the camera."""
    pixels, depth = camera.project(points_world)
    if not (depth > 0).all():
        return True
    return bool((pixels < 0).any() or (pixels > np.array(camera.size)).any())


def rounded_up(length: int, multiple: int) -> int:
    """The least multiple that is not below a length."""
    return length + -length % multiple


def _meeting(start: int, length: int, size: int) -> tuple[slice, slice]:
    """The lines of a picture that a window has, counted in the picture and in the window."""
    first = min(max(start, 0), size)
    last = max(min(start + length, size), first)
    return slice(first, last), slice(first - start, last - start)
