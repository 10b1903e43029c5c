"""The surface where a field is one half, found from coarse to fine so that empty space is skipped.

Each lattice has the points of the one before it and those between them. A point is asked for where
the field crosses one half nearby, and elsewhere keeps what lies between its neighbours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from harness.core.arrays import Floats, Mask, Singles
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.geometry.isosurface import isosurface
from harness.geometry.topology import largest_piece

#: The field is at least this inside.
INSIDE = 0.5
#: Cells along each axis of the coarsest lattice: 33 points, as published.
_COARSEST = 32

#: Values (N,) of a field at points (N, 3) of the cube, from -1 to 1 along each axis.
Field = Callable[[Floats], Singles]


def contoured_field(field: Field, cells: int, looked_at: Mask) -> Mesh:
    """The largest piece of the surface around what is inside, facing outwards, closed.

    Args:
        field: Above one half inside.
        cells: Along each axis of the finest lattice, 32 times a power of two.
        looked_at: (D, D, D) voxels by (x, y, z) that all finer lattices ask around, however little
            the coarsest one sees.

    Raises:
        MethodError: the field is inside nowhere.
    """
    values = refined(field, cells, looked_at)
    if not (values > INSIDE).any():
        raise MethodError(
            "the completed surface is empty",
            expected="occupancies above one half",
            got=f"at most {values.max():.3g}",
        )
    outside = min(0.0, float(values.min()))
    mesh = isosurface(values, level=INSIDE, outside=outside, source="completed surface")
    return largest_piece(replace(mesh, vertices=2.0 * mesh.vertices / cells - 1.0))


def refined(field: Field, cells: int, looked_at: Mask) -> Singles:
    """(cells + 1,)*3 values of a field on a lattice by (x, y, z); arguments as above."""
    size = min(_COARSEST, cells)
    values = np.empty((size + 1,) * 3, dtype=np.float32)
    _ask(field, values, np.ones(values.shape, dtype=bool))
    while size < cells:
        size *= 2
        wanted = _between(_crossed(values) | _around(looked_at, size // 2))
        known = np.zeros((size + 1,) * 3, dtype=bool)
        known[::2, ::2, ::2] = True
        values = _doubled(values)
        _ask(field, values, wanted & ~known)
    return values


def _ask(field: Field, values: Singles, wanted: Mask) -> None:
    """Fill in the field's values where they are wanted."""
    places = np.argwhere(wanted)
    values[wanted] = field(2.0 * places / (len(values) - 1) - 1.0)


def _crossed(values: Singles) -> Mask:
    """(C, C, C) cells with corners both inside and outside, and the cells beside them."""
    from scipy.ndimage import binary_dilation

    inside = values > INSIDE
    corners = [
        inside[x : x - 1 or None, y : y - 1 or None, z : z - 1 or None]
        for x in (0, 1)
        for y in (0, 1)
        for z in (0, 1)
    ]
    mixed = np.logical_or.reduce(corners) & ~np.logical_and.reduce(corners)
    return np.asarray(binary_dilation(mixed, np.ones((3, 3, 3)))).astype(bool)


def _around(voxels: Mask, cells: int) -> Mask:
    """(C, C, C) cells that hold a voxel; with more cells than voxels, none."""
    width, rest = divmod(len(voxels), cells)
    if width == 0 or rest or cells > _COARSEST:
        return np.zeros((cells,) * 3, dtype=bool)
    blocks = voxels.reshape(cells, width, cells, width, cells, width)
    held: Mask = np.logical_or.reduce(blocks, axis=(1, 3, 5))
    return held


def _between(cells: Mask) -> Mask:
    """(2 C + 1,)*3 points of the lattice of half the step that lie in or on marked cells."""
    points = np.zeros(tuple(2 * count + 1 for count in cells.shape), dtype=bool)
    for x in range(3):
        for y in range(3):
            for z in range(3):
                part = tuple(
                    slice(start, start + 2 * count - 1, 2)
                    for start, count in zip((x, y, z), cells.shape, strict=True)
                )
                points[part] |= cells
    return points


def _doubled(values: Singles) -> Singles:
    """The same values with their neighbours' means between them, along each axis."""
    for axis in range(3):
        along = np.moveaxis(values, axis, 0)
        finer = np.empty((2 * len(along) - 1, *along.shape[1:]), dtype=np.float32)
        finer[::2] = along
        finer[1::2] = (along[1:] + along[:-1]) / 2.0
        values = np.moveaxis(finer, 0, axis)
    return np.ascontiguousarray(values)
