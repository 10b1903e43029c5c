"""One sparse linear least-squares problem: how far each vertex moves along its direction."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import AnyInts, Floats
from methods.closed.surfaces import Surface

#: Keeps a vertex that no row holds where it is.
_RIDGE = 1e-12
#: Squares of edges shorter than a third of a millimetre count as that.
_SHORTEST_M2 = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class SingleRows:
    """Rows ``weight * (coefficient * t[vertex] - value) ** 2``.

    Attributes:
        vertices: (K,) indices.
        coefficients, values, weights: (K,).
    """

    vertices: AnyInts
    coefficients: Floats
    values: Floats
    weights: Floats


@dataclass(frozen=True, slots=True, eq=False)
class PairRows:
    """Rows ``weight * (a * t[first] + b * t[second] - value) ** 2``.

    Attributes:
        first, second: (K,) vertex indices.
        a, b, values, weights: (K,).
    """

    first: AnyInts
    second: AnyInts
    a: Floats
    b: Floats
    values: Floats
    weights: Floats


class MoveProblem:
    """Collects rows and solves for one move per vertex, metres.

    Args:
        count: Number of vertices.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._diagonal = np.full(count, _RIDGE)
        self._right = np.zeros(count)
        self._pairs: list[tuple[AnyInts, AnyInts, Floats]] = []

    def add_single(self, rows: SingleRows) -> None:
        """Rows with one unknown each."""
        weighted = rows.weights * rows.coefficients
        self._add_at(rows.vertices, weighted * rows.coefficients, weighted * rows.values)

    def add_pairs(self, parts: Iterable[PairRows]) -> None:
        """Rows with two unknowns each."""
        for rows in parts:
            first, second = rows.weights * rows.a, rows.weights * rows.b
            self._add_at(rows.first, first * rows.a, first * rows.values)
            self._add_at(rows.second, second * rows.b, second * rows.values)
            self._pairs.append((rows.first, rows.second, first * rows.b))

    def _add_at(self, vertices: AnyInts, diagonal: Floats, right: Floats) -> None:
        self._diagonal += np.bincount(vertices, diagonal, self._count)
        self._right += np.bincount(vertices, right, self._count)

    def solved(self) -> Floats:
        """(V,) moves that minimise the sum of all rows.

        A sparse factorisation: the matrix is symmetric and positive definite, so that SuperLU needs
        no pivoting. It takes 0.6 s for 74,000 vertices and 1.2 s for 124,000 on one core. Conjugate
        gradients with the diagonal as preconditioner take a third of that where all rows weigh
        alike, and leave weakly held parts unsolved where they do not.
        """
        from scipy.sparse.linalg import splu

        factors = splu(
            self.matrix().tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        return factors.solve(self._right)

    def matrix(self):  # noqa: ANN201
        """(V, V) the symmetric matrix of the normal equations."""
        from scipy.sparse import csr_array

        vertices = np.arange(self._count)
        first = np.concatenate([vertices, *(part[0] for part in self._pairs)])
        second = np.concatenate([vertices, *(part[1] for part in self._pairs)])
        # Half of the diagonal, because the transpose is added.
        values = np.concatenate([self._diagonal / 2, *(part[2] for part in self._pairs)])
        half = csr_array((values, (first, second)), shape=(self._count, self._count))
        return half + half.T


def slope_rows(surface: Surface, normals: Floats, weights: Floats) -> Iterable[PairRows]:
    """Rows that ask the edges of each face to be square to a normal.

    After Nehab et al., "Efficiently combining positions and normals for precise 3D geometry", 2005.

    Args:
        surface: Vertices move along its ``directions``.
        normals: (F, 3) unit; the edges of a face are asked to be square to its normal.
        weights: (F,) of each face's three rows, on top of its area.
    """
    vertices, directions = surface.mesh.vertices, surface.directions
    used = np.flatnonzero(weights > 0)
    faces, asked = surface.mesh.faces[used], normals[used]
    weight = weights[used] * surface.areas_m2[used]
    along = [np.einsum("ij,ij->i", asked, directions[corner]) for corner in faces.T]
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = vertices[faces[:, start]] - vertices[faces[:, end]]
        squared = np.maximum(np.einsum("ij,ij->i", edge, edge), _SHORTEST_M2)
        yield PairRows(
            first=faces[:, start],
            second=faces[:, end],
            a=along[start],
            b=-along[end],
            values=-np.einsum("ij,ij->i", asked, edge),
            weights=weight / squared,
        )
