"""Cloth that is too long for its place, brought to rest: edges reach their lengths, bends resist.

Position-based: every step moves each vertex by the mean of what its edges ask for, damps bending of
the displacement, and keeps the cloth off what it lies on. Momentum makes it quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.quads import Floats, Ints, SparseMatrix, neighbour_means
from harness.core.arrays import Mask
from harness.geometry.coinciding import edges_of

_STEP = 0.45
_MOMENTUM = 0.85
_KEEP = 0.9995
_REACH_M = 0.025
_DIAGONAL = 0.5
"""Weight of a quad's diagonals: cloth shears more easily than it stretches."""
_BELOW_M = 0.025


@dataclass(frozen=True)
class Springs:
    """ends (E,2), weights (E,), and the matrices from vertices to differences and back."""

    ends: Ints
    weights: Floats
    difference: SparseMatrix
    gather: SparseMatrix
    means: SparseMatrix


@dataclass(frozen=True)
class Contact:
    """A plane per vertex that it stays above: points (V,3), unit normals (V,3), gaps (V,) m."""

    points: Floats
    normals: Floats
    gaps: Floats


@dataclass(frozen=True)
class Held:
    """Which vertices (V,) stay where they are, and what the others stay off."""

    fixed: Mask
    off: Sequence[Contact]


@dataclass(frozen=True)
class Steps:
    """How many steps, and the share of a bend that each takes away."""

    count: int
    bending: float


def springs(size: int, quads: Ints) -> Springs:
    """The springs of a quad mesh with ``size`` vertices: its edges, then its diagonals."""
    from scipy.sparse import coo_matrix, diags

    edges = edges_of(quads).ends
    diagonals = np.concatenate([quads[:, [0, 2]], quads[:, [1, 3]]])
    ends = np.concatenate([edges, diagonals])
    weights = np.concatenate([np.ones(len(edges)), np.full(len(diagonals), _DIAGONAL)])
    distinct = ends[:, 0] != ends[:, 1]
    ends, weights = ends[distinct], weights[distinct]
    rows = np.arange(len(ends))
    signs = np.concatenate([np.ones(len(ends)), -np.ones(len(ends))])
    places = (np.concatenate([rows, rows]), ends.T.ravel())
    difference = coo_matrix((signs, places), shape=(len(ends), size)).tocsr()
    total = np.bincount(ends.ravel(), np.repeat(weights, 2), minlength=size)
    gather = (diags(_STEP / np.maximum(total, 1e-9)) @ difference.T @ diags(weights)).tocsr()
    return Springs(ends, weights, difference, gather, neighbour_means(size, quads))


def contacts(points: Floats, obstacles: Sequence[Nearness], gap_m: float) -> list[Contact]:
    """What vertices (V,3) stay off. What is deep below a surface keeps its depth: it is tucked."""
    found: list[Contact] = []
    for obstacle in obstacles:
        height, outward = obstacle.height(points)
        nearest = points - height[:, None] * outward
        gaps = np.where(height > -_BELOW_M, gap_m, height)
        found.append(Contact(nearest, outward, gaps))
    return found


def relaxed(
    rest: Floats, start: Floats, lengths: Floats, net: Springs, steps: Steps, held: Held
) -> Floats:
    """Vertices (V,3) at rest near ``rest`` (V,3), from ``start`` (V,3), with edges of ``lengths``.

    No vertex ends more than 25 mm from ``rest`` but where something pushes it.
    """
    single = np.float32
    difference, gather, means = (
        matrix.astype(single) for matrix in (net.difference, net.gather, net.means)
    )
    origin, wanted = rest.astype(single), lengths.astype(single)
    free = np.where(held.fixed, 0.0, 1.0).astype(single)[:, None]
    now = start.astype(single)
    before = now.copy()
    for _ in range(steps.count):
        ahead = now + single(_MOMENTUM) * (now - before)
        before = now
        way = difference @ ahead
        length = np.sqrt(np.einsum("ed,ed->e", way, way))
        ahead += gather @ (way * ((wanted - length) / np.maximum(length, single(1e-6)))[:, None])
        moved = ahead - origin
        bend = moved - means @ moved
        bend -= means @ bend
        moved -= single(steps.bending) * bend
        moved *= single(_KEEP)
        far = np.sqrt(np.einsum("vd,vd->v", moved, moved))
        moved *= np.minimum(single(1), single(_REACH_M) / np.maximum(far, single(1e-9)))[:, None]
        now = origin + free * moved
        for contact in held.off:
            height = np.einsum("vd,vd->v", now - contact.points, contact.normals)
            now = now + np.maximum(contact.gaps - height, 0)[:, None] * contact.normals
        now = now.astype(single)
    return now.astype(float)
