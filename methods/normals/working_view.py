"""The picture that normals are estimated in: a square around the subject, at a working size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.artifacts import Capture
from harness.core.cameras.camera import Camera
from harness.core.errors import MethodError
from harness.geometry.images import composite, load_rgba, resampled
from harness.geometry.place import mask_box

__all__ = ["WorkingView", "working_view"]


#: Share of the square that the subject's longer side fills, as in ECON's crops.
_FILLED = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class WorkingView:
    """One view, cropped and resampled; everything in it is on the pixel grid of ``camera``.

    Attributes:
        index: In the capture.
        camera: The capture's full perspective camera, for this window and size.
        rgb: (H, W, 3) sRGB in [0, 1], black outside the subject.
        mask: (H, W) where at least half of the pixel is subject.
    """

    index: int
    camera: Camera
    rgb: Floats
    mask: Mask


def working_view(capture: Capture, index: int, resolution: int) -> WorkingView:
    """A view of a capture as a square of ``resolution`` pixels around its subject.

    The square may reach outside the picture, where nothing is; a picture is never enlarged.

    Raises:
        MethodError: the view shows no subject.
    """
    camera = capture.cameras[index]
    rgba = load_rgba(capture.image_path(index), camera.size)
    inside = rgba[..., 3] >= 128
    if not inside.any():
        raise MethodError(
            f"view {index} of {capture.subject} shows no subject",
            expected="a mask that is not empty",
            got=str(capture.image_path(index)),
        )
    left, top, side = _square(inside)
    size = min(resolution, side)
    window = camera.cropped(left, top, side, side).resized(size, size)
    colour = resampled(_cut(composite(rgba), left, top, side), (size, size), "bilinear")
    alpha = _cut(rgba[..., 3:] / 255.0, left, top, side)[..., 0]
    coverage = resampled(alpha, (size, size), "bilinear")
    mask = coverage >= 0.5
    return WorkingView(index, window, colour * mask[..., None], mask)


def _square(inside: Mask) -> tuple[int, int, int]:
    """Left, top and side in whole pixels of the square around a mask (H, W)."""
    left, top, right, bottom = mask_box(inside)
    side = int(np.ceil(max(bottom - top, right - left) / _FILLED))
    return (left + right - side) // 2, (top + bottom - side) // 2, side


def _cut(image: Floats, left: int, top: int, side: int) -> Floats:
    """The square (side, side, C) of an image (H, W, C), zero outside it."""
    height, width = image.shape[:2]
    square = np.zeros((side, side, image.shape[2]))
    rows = slice(max(top, 0), min(top + side, height))
    columns = slice(max(left, 0), min(left + side, width))
    square[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = image[
        rows, columns
    ]
    return square
