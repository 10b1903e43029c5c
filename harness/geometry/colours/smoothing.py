"""Values on the vertices of a surface: spread along it, and continued where nothing is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints, Mask, Singles
from harness.core.mesh import Mesh
from harness.geometry.coinciding import merged_positions
from harness.geometry.surface import vertex_normals
from harness.geometry.topology import components, edges_of

#: Vertices are put together in cells of this share of the wanted width.
_CELL_SHARE = 1.0 / 3.0


@dataclass(frozen=True, eq=False)
class _Cells:
    """Vertices put together, by place and by the direction that the surface faces."""

    of_vertex: Ints
    spread: Any
    count: int
    steps: int
    fine_steps: int


class SurfaceGraph:
    """The vertices of a mesh and the edges between them; vertices at one place are one.

    Attributes:
        mesh: The surface.
        place: (V,) the number of the place of each vertex; there are ``count``.
    """

    def __init__(self, mesh: Mesh) -> None:
        from scipy.sparse import coo_array

        self.mesh = mesh
        self.place = merged_positions(mesh.vertices)
        self.count = int(self.place.max()) + 1
        ends = edges_of(self.place[mesh.faces]).ends
        ends = ends[ends[:, 0] != ends[:, 1]]
        self.ends = ends
        both = np.concatenate([ends, ends[:, ::-1]])
        ones = np.ones(len(both), dtype=np.float32)
        shape = (self.count, self.count)
        self.neighbours = coo_array((ones, (both[:, 0], both[:, 1])), shape=shape).tocsr()
        self.positions = np.empty((self.count, 3))
        self.positions[self.place] = mesh.vertices
        self.normals = np.empty((self.count, 3))
        self.normals[self.place] = vertex_normals(mesh)
        self._cells: dict[float, _Cells] = {}

    def spread(self, values: Singles, width_m: float) -> Singles:
        """(count, C) values averaged along the surface, about as by a Gaussian.

        Args:
            values: (count, C), one row for each place.
            width_m: Its standard deviation, metres.
        """
        cells = self._cells_of(width_m)
        sums = np.stack(
            [np.bincount(cells.of_vertex, column, cells.count) for column in values.T], axis=1
        )
        held = np.bincount(cells.of_vertex, minlength=cells.count)[:, None]
        # Weighted by how much surface a cell holds, so that a sliver counts little.
        top, below = sums.astype(np.float32), held.astype(np.float32)
        for _ in range(cells.steps):
            top, below = cells.spread @ top, cells.spread @ below
        fine = (top / below)[cells.of_vertex]
        degree = 1.0 + np.diff(self.neighbours.indptr)[:, None].astype(np.float32)
        for _ in range(cells.fine_steps):
            fine = (self.neighbours @ fine + fine) / degree
        return fine

    def filled(self, values: Floats, known: Mask) -> Floats:
        """(count, C) values, continued harmonically from the known places to the others.

        A piece of the surface without any known place gets the mean of all known values.
        """
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        result = values.copy()
        if not known.any() or known.all():
            return result
        result[~known] = values[known].mean(axis=0)
        pieces = components(self.count, self.ends[:, 0], self.ends[:, 1])
        has_known = np.zeros(int(pieces.max()) + 1, dtype=bool)
        has_known[pieces[known]] = True
        sought = np.flatnonzero(~known & has_known[pieces])
        if not len(sought):
            return result
        rows = self.neighbours[sought].astype(np.float64)
        laplacian = diags_array(rows.sum(axis=1)) - rows[:, sought]
        given = rows[:, np.flatnonzero(known)] @ values[known]
        options = {"SymmetricMode": True}
        solver = splu(laplacian.tocsc(), permc_spec="MMD_AT_PLUS_A", options=options)
        result[sought] = solver.solve(given)
        return result

    def _cells_of(self, width_m: float) -> _Cells:
        if width_m not in self._cells:
            self._cells[width_m] = self._made_cells(width_m)
        return self._cells[width_m]

    def _made_cells(self, width_m: float) -> _Cells:
        from scipy.sparse import coo_array

        cell_m = _CELL_SHARE * width_m
        axis = np.abs(self.normals).argmax(axis=1)
        turned = np.take_along_axis(self.normals, axis[:, None], 1)[:, 0] < 0
        where = np.floor(self.positions / cell_m)
        of_vertex = merged_positions(np.column_stack([where, axis + 3.0 * turned]))
        count = int(of_vertex.max()) + 1
        ends = of_vertex[self.ends]
        itself = np.repeat(np.arange(count)[:, None], 2, axis=1)
        pairs = np.unique(np.concatenate([ends, ends[:, ::-1], itself]), axis=0)
        share = 1.0 / np.bincount(pairs[:, 1], minlength=count)
        spread = coo_array(
            (share[pairs[:, 1]].astype(np.float32), (pairs[:, 0], pairs[:, 1])),
            shape=(count, count),
        )
        apart = self.positions[self.ends[:, 0]] - self.positions[self.ends[:, 1]]
        edge_m = float(np.median(np.linalg.norm(apart, axis=1)))
        return _Cells(
            of_vertex,
            spread.tocsr(),
            count,
            # A step to one of about six neighbours, or none, adds 3/7 of its squared length.
            steps=max(1, round(7 / 3 / _CELL_SHARE**2)),
            fine_steps=min(16, max(1, round(7 / 3 * (0.5 * cell_m / edge_m) ** 2))),
        )
