"""Colours of a surface as one picture: texels for the corners of faces, pictures side by side."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import AnyInts, Bytes, Floats
from harness.core.errors import DataError
from harness.geometry.images import MOST_PIXELS, linear_from_srgb, srgb_from_linear

_LONGEST_SIDE = 16384
#: A face's corners may lie this far beyond its picture and still not repeat it.
_SLACK = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Paint:
    """The colours of some faces.

    Attributes:
        pixels: (H, W, 3) uint8 sRGB.
        uv: (T, 2) texture coordinates, origin at the bottom left.
        face_uv: (F, 3) indices into ``uv``.
    """

    pixels: Bytes
    uv: Floats
    face_uv: AnyInts


def paint_of_corners(colours: Bytes) -> Paint:
    """Two by two texels for each face, between which colours run as between its corners.

    The coordinates are those of texel centres, so that no filter reaches a neighbour's texels. The
    fourth texel continues the other three in linear light, from the corner from which that is a
    colour; where none is, the middle of the opposite edge is off by a quarter of what is missing.

    Args:
        colours: (F, 3, 3) uint8 sRGB of the corners of faces.

    Raises:
        DataError: more faces than a picture has room for.
    """
    count = len(colours)
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    if 4 * rows * columns > MOST_PIXELS:
        raise DataError(
            f"{count} faces with colours of their own are too many",
            expected=f"at most {MOST_PIXELS // 4}",
            hint="Decimate the scan",
        )
    linear = linear_from_srgb(np.arange(256) / 255.0)[colours]
    continued = linear.sum(axis=1, keepdims=True) - 2.0 * linear
    possible = np.clip(continued, 0.0, 1.0)
    first = np.abs(continued - possible).max(axis=2).argmin(axis=1)
    order = (first[:, None] + np.arange(3)) % 3
    faces = np.arange(count)[:, None]
    fourth = np.round(255 * srgb_from_linear(possible[faces[:, 0], first])).astype(np.uint8)
    texels = np.concatenate([colours[faces, order], fourth[:, None]], axis=1)
    padded = np.zeros((rows * columns, 2, 2, 3), np.uint8)
    padded[:count] = texels.reshape(count, 2, 2, 3)
    pixels = padded.reshape(rows, columns, 2, 2, 3).swapaxes(1, 2)
    row, column = np.divmod(np.arange(count), columns)
    x = 2 * column[:, None] + (0.5, 1.5, 0.5)
    y = 2 * row[:, None] + (0.5, 0.5, 1.5)
    uv = np.stack([x / (2 * columns), 1.0 - y / (2 * rows)], axis=-1)
    return Paint(
        np.ascontiguousarray(pixels.reshape(2 * rows, 2 * columns, 3)),
        uv.reshape(-1, 2),
        # Corner k of a face is at the place that it has in the order of its texels.
        3 * faces + np.argsort(order, axis=1),
    )


def joined(paints: Sequence[Paint], source: str) -> Paint:
    """The faces of all, in order, with their pictures one above the other.

    Pictures have a border of their own texels, so that no filter reaches a neighbour.

    Raises:
        DataError: a picture that is repeated across a face, or too many pixels.
    """
    if len(paints) == 1:
        return paints[0]
    bordered = [np.pad(each.pixels, ((1, 1), (1, 1), (0, 0)), mode="edge") for each in paints]
    width = max(each.shape[1] for each in bordered)
    height = sum(each.shape[0] for each in bordered)
    if height * width > MOST_PIXELS or max(height, width) > _LONGEST_SIDE:
        raise DataError(
            f"the pictures of {source} have too many pixels together",
            expected=f"at most {MOST_PIXELS} pixels and {_LONGEST_SIDE} in a row or column",
            got=f"{width} x {height}",
            hint="Bake them into one texture",
        )
    pixels = np.zeros((height, width, 3), np.uint8)
    uv: list[Floats] = []
    top = 0
    for paint, picture in zip(paints, bordered, strict=True):
        rows, columns = picture.shape[:2]
        pixels[top : top + rows, :columns] = picture
        place = _within(paint, source)
        x = 1.0 + place[:, 0] * (columns - 2)
        y = top + 1.0 + (1.0 - place[:, 1]) * (rows - 2)
        uv.append(np.stack([x / width, 1.0 - y / height], axis=1))
        top += rows
    together = np.concatenate(uv)
    return Paint(pixels, together, np.arange(len(together)).reshape(-1, 3))


def _within(paint: Paint, source: str) -> Floats:
    """(3 F, 2) coordinates of the corners of faces, moved by whole pictures into the picture."""
    corners = paint.uv[paint.face_uv]
    moved = corners - np.floor(corners.min(axis=1, keepdims=True) + _SLACK)
    if moved.max(initial=0.0) > 1.0 + _SLACK:
        raise DataError(
            f"{source} repeats one of its several pictures across a face",
            expected="texture coordinates from 0 to 1",
            hint="Bake its materials into one texture",
        )
    return np.clip(moved.reshape(-1, 2), 0.0, 1.0)
