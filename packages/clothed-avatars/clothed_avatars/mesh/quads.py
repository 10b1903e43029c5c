"""Quad surfaces that carry values along: subdivision, relaxation, borders, normals.

Cloth is cut and draped on quads, whose rows and columns play the part of warp and weft.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.geometry.coinciding import edges_of, half_edges

SparseMatrix: TypeAlias = Any
"""A scipy.sparse matrix in CSR form; scipy does not type it."""


def triangles(faces: Ints) -> Ints:
    """Triangles (T,3) of quads (Q,4), or the triangles given; collapsed corners are left out."""
    if faces.shape[1] == 3:
        return faces
    split = faces[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    distinct = (
        (split[:, 0] != split[:, 1]) & (split[:, 1] != split[:, 2]) & (split[:, 2] != split[:, 0])
    )
    return split[distinct]


def compact(faces: Ints) -> tuple[Ints, Ints]:
    """The vertices (N,) that faces use, and the faces renumbered to them."""
    used, renumbered = np.unique(faces, return_inverse=True)
    return used, renumbered.reshape(faces.shape)


def _sides(faces: Ints) -> Ints:
    """Directed edges (F*K,2), face after face."""
    return np.stack(half_edges(faces), axis=1)


def subdivision(size: int, quads: Ints) -> tuple[SparseMatrix, Ints]:
    """The matrix from values of ``size`` vertices to a surface twice as fine, and its quads.

    New values are plain means: old vertices, then edges, then faces.
    """
    from scipy.sparse import coo_matrix, identity, vstack

    edges = edges_of(quads)
    edge_of = edges.of_side + size
    centre = size + len(edges.ends) + np.arange(len(quads))

    def mean(members: Ints) -> SparseMatrix:
        count, per = members.shape
        rows = np.repeat(np.arange(count), per)
        values = np.full(count * per, 1 / per)
        return coo_matrix((values, (rows, members.ravel())), shape=(count, size)).tocsr()

    matrix = vstack([identity(size), mean(edges.ends), mean(quads)]).tocsr()
    parts = [
        np.stack([quads[:, k], edge_of[:, k], centre, edge_of[:, k - 1]], axis=1) for k in range(4)
    ]
    return matrix, np.concatenate(parts)


def neighbour_means(size: int, faces: Ints) -> SparseMatrix:
    """The matrix that takes the mean of each vertex's neighbours."""
    from scipy.sparse import coo_matrix, diags

    sides = _sides(faces)
    rows, columns = np.concatenate([sides, sides[:, ::-1]]).T
    ring = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(size, size)).tocsr()
    ring.data[:] = 1.0
    return diags(1 / np.maximum(np.asarray(ring.sum(1)).ravel(), 1)) @ ring


def _open_sides(faces: Ints) -> Ints:
    """Directed edges (N,2) that no face goes the other way, face after face."""
    sides = _sides(faces)
    start, end = sides.T
    size = int(sides.max(initial=0)) + 1
    met = np.isin(end * size + start, start * size + end)
    return sides[(start != end) & ~met]


def border_loops(faces: Ints) -> list[Ints]:
    """Each closed border as the vertices along it, in the direction of its faces; longest first."""
    following: dict[int, int] = dict(_open_sides(faces).tolist())
    loops: list[list[int]] = []
    while following:
        start, vertex = following.popitem()
        loop = [start]
        while vertex != start and vertex in following:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(loop)
    # Start each loop at its lowest vertex, so that the order does not hang on the dictionary's.
    rolled = [np.roll(loop, -int(np.argmin(loop))) for loop in loops]
    return sorted(rolled, key=lambda loop: (-len(loop), int(loop[0])))


def on_border(size: int, faces: Ints) -> Mask:
    """(V,) which of ``size`` vertices lie on a border."""
    edges = edges_of(faces)
    out = np.zeros(size, bool)
    out[edges.ends[edges.counts == 1].ravel()] = True
    return out


def relax(vertices: Floats, faces: Ints, times: int, share: float = 0.5) -> Floats:
    """Vertices (V,3) moved ``times`` towards the mean of their neighbours; borders are held."""
    ring = neighbour_means(len(vertices), faces)
    free = np.full((len(vertices), 1), share)
    for loop in border_loops(faces):
        free[loop] = 0.0
    for _ in range(times):
        vertices = vertices + free * (ring @ vertices - vertices)
    return vertices


def relax_border(vertices: Floats, faces: Ints, times: int = 1) -> Floats:
    """Vertices with each border made smoother along itself."""
    vertices = vertices.copy()
    for loop in border_loops(faces):
        for _ in range(times):
            around = vertices[np.roll(loop, 1)] + vertices[np.roll(loop, -1)]
            vertices[loop] = 0.5 * vertices[loop] + 0.25 * around
    return vertices


def refine(
    vertices: Floats, quads: Ints, levels: int, attributes: Floats | None = None
) -> tuple[Floats, Ints, Floats]:
    """A smooth, finer surface (V',3), its quads, and per-vertex attributes (V,K) carried along."""
    values = np.zeros((len(vertices), 0)) if attributes is None else attributes
    for _ in range(levels):
        matrix, quads = subdivision(len(vertices), quads)
        vertices, values = matrix @ vertices, matrix @ values
        vertices = relax_border(relax(vertices, quads, 1), quads)
    return vertices, quads, values


def vertex_normals(vertices: Floats, faces: Ints) -> Floats:
    """Area-weighted unit normals (V,3) of the vertices of quads or triangles."""
    last = faces[:, -1]
    if faces.shape[1] == 4:
        first, second = (
            vertices[faces[:, 2]] - vertices[faces[:, 0]],
            vertices[last] - vertices[faces[:, 1]],
        )
    else:
        first, second = (
            vertices[faces[:, 1]] - vertices[faces[:, 0]],
            vertices[last] - vertices[faces[:, 0]],
        )
    area = np.cross(first, second)
    corners = faces.shape[1]
    normals = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(area[:, k], corners), minlength=len(vertices))
            for k in range(3)
        ],
        axis=1,
    )
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def grid(points: Floats, closed: bool) -> tuple[Floats, Ints]:
    """Vertices and quads of a grid (R,C,3); ``closed`` joins the last column to the first."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    if closed:
        index = np.concatenate([index, index[:, :1]], axis=1)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1)
    return points.reshape(-1, 3), quads.reshape(-1, 4)
