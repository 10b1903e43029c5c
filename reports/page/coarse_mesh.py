"""A coarse form of a large mesh, which a page draws at once while the full one is on its way.

Vertices are joined by the cells of a lattice: each cell that holds some becomes one vertex at their
mean. That takes some ten milliseconds, gives the same bytes each time, and needs no closed surface.
"""

from __future__ import annotations

import math

import numpy as np

from harness.core.arrays import Floats, Ints
from harness.core.mesh import Mesh
from reports.page.compact_mesh import CompactMesh, ScalarColumn

#: About how many faces a coarse mesh has.
COARSE_FACES = 25_000
#: A mesh with fewer faces than this many times as many is drawn as it is.
_WORTH = 2.0
#: How many lattices are tried before the one that is taken.
_TRIALS = 2


def coarse_mesh(
    mesh: Mesh, columns: tuple[ScalarColumn, ...] = (), about: int = COARSE_FACES
) -> CompactMesh | None:
    """A mesh of fewer faces with the columns' means; None where that would not save half of them.

    Args:
        mesh: Any, open ones as well.
        columns: By vertex of the mesh; a vertex that has no value has no part in a mean.
        about: How many faces are wanted.
    """
    if len(mesh.faces) < _WORTH * about:
        return None
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.faces.ravel()] = True
    points, corners = mesh.vertices[used], (np.cumsum(used) - 1)[mesh.faces]
    cell = float(np.ptp(points, axis=0).max()) / math.sqrt(about)
    for _ in range(_TRIALS):
        # The number of faces falls with the square of the cell's side.
        count = len(_joined(corners, _cells(points, cell)))
        cell *= math.sqrt(max(count, 1) / about)
    cells = _cells(points, cell)
    faces = _joined(corners, cells)
    if not 0 < len(faces) <= len(mesh.faces) / _WORTH:
        return None
    return CompactMesh.of(
        Mesh(np.stack([_means(axis, cells) for axis in points.T], axis=1), faces),
        tuple(ScalarColumn(c.id, _means(c.values[used], cells), c.step) for c in columns),
    )


def _cells(points: Floats, cell: float) -> Ints:
    """(V,) the number of each point's cell, without gaps."""
    place = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    sides = place.max(axis=0) + 1
    return np.unique(np.ravel_multi_index(tuple(place.T), tuple(sides)), return_inverse=True)[1]


def _joined(corners: Ints, cells: Ints) -> Ints:
    """(F, 3) the faces that have corners in three cells, in their order."""
    joined = cells[corners]
    a, b, c = joined.T
    return joined[(a != b) & (b != c) & (a != c)]


def _means(values: Floats, cells: Ints) -> Floats:
    """The mean of each cell's values; NaN for a cell without any."""
    known = ~np.isnan(values)
    size = int(cells.max()) + 1
    total = np.bincount(cells[known], values[known], size)
    count = np.bincount(cells[known], minlength=size)
    return np.divide(total, count, out=np.full(size, np.nan), where=count > 0)
