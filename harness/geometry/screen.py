"""Where a mesh lies in a picture: its rectangle of pixels, and whether the frame cuts it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness.core.cameras.camera import Camera

__all__ = ["Rectangle", "screen_rectangle"]


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A window of whole pixels, inside its picture.

    Attributes:
        left: First column.
        top: First row.
        width: Columns; 0 when there is nothing in the picture.
        height: Rows.
        cut: Whether the subject goes on beyond the frame (or behind the camera).
    """

    left: int
    top: int
    width: int
    height: int
    cut: bool

    @property
    def slices(self) -> tuple[slice, slice]:
        """Row and column slices of the window in a full (H, W, ...) array."""
        return (
            slice(self.top, self.top + self.height),
            slice(self.left, self.left + self.width),
        )

    @property
    def empty(self) -> bool:
        """Whether the window has no pixels."""
        return self.width == 0 or self.height == 0


def screen_rectangle(points_world: ArrayLike, camera: Camera, *, margin: int = 1) -> Rectangle:
    """The least window of the picture that holds the projections of points (N, 3), world metres.

    A triangle mesh projects inside the window of its vertices. When a point is behind the camera
    nothing can be said and the window is the whole picture.

    Args:
        points_world: (N, 3) metres, N >= 1.
        camera: The view.
        margin: Pixels added on each side, against rounding.
    """
    pixels, depth = camera.project(points_world)
    if not (depth > 0).all():
        return Rectangle(0, 0, camera.width, camera.height, cut=True)
    size = np.array([camera.width, camera.height])
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    cut = bool((low < 0).any() or (high > size).any())
    first = np.clip(np.floor(low) - margin, 0, size)
    last = np.clip(np.ceil(high) + margin, first, size)
    width, height = last - first
    if width == 0 or height == 0:
        width = height = 0.0
    return Rectangle(
        math.floor(first[0]), math.floor(first[1]), math.floor(width), math.floor(height), cut
    )
