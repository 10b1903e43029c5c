"""Triangle surfaces that carry values along: subdivision, clipping at a field, normals.

Everything here is plain linear algebra on arrays: an operation returns new faces and a sparse
matrix that maps any per-vertex value (position, skinning weight, field) of the old vertices to the
new ones, so geometry, weights and texture coordinates can never fall out of step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

__all__ = [
    "Floats",
    "Ints",
    "Patch",
    "boundary_edges",
    "clip",
    "compact",
    "smooth",
    "split_quads",
    "subdivide",
    "vertex_normals",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Patch:
    """A surface in the rest pose: vertices (V,3) m, faces (F,3), the bone weights of its vertices
    (V,B, sparse), and texture corners uv (T,2) in [0,1] with their own faces (F,3).
    """

    vertices: Floats
    faces: Ints
    weights: csr_matrix
    uv: Floats
    uv_faces: Ints

    def moved(self, vertices: Floats) -> Patch:
        """The same surface with other vertex positions."""
        return Patch(vertices, self.faces, self.weights, self.uv, self.uv_faces)


def split_quads(quads: Ints) -> Ints:
    """Triangles (2Q,3) of quads (Q,4), the two halves of a quad next to each other."""
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def _edges(faces: Ints) -> tuple[Ints, Ints, Ints]:
    """Unique edges (E,2), the edge of each face side (F,3), the number of faces of each edge."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, side_edge, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    return edges, side_edge.reshape(-1, 3), count


def boundary_edges(faces: Ints) -> Ints:
    """Directed edges (E,2) that belong to one face only, in that face's own direction."""
    _, side_edge, count = _edges(faces)
    sides = faces[:, [[0, 1], [1, 2], [2, 0]]]
    return sides[count[side_edge] == 1]


def _loop_matrix(
    vertex_count: int, faces: Ints, edges: Ints, side_edge: Ints, count: Ints
) -> csr_matrix:
    """Loop's masks: the limit surface is smooth, borders are cubic B-splines of themselves."""
    from scipy.sparse import coo_matrix, csr_matrix, diags, vstack

    edge_ids = np.arange(len(edges))
    inner = count == 2
    ends = coo_matrix(
        (
            np.where(np.repeat(inner, 2), 3 / 8, 1 / 2),
            (np.repeat(edge_ids, 2), edges.ravel()),
        ),
        shape=(len(edges), vertex_count),
    )
    side = side_edge.ravel()
    across = faces[:, [2, 0, 1]].ravel()
    use = inner[side]
    wings = coo_matrix(
        (np.full(int(use.sum()), 1 / 8), (side[use], across[use])), shape=(len(edges), vertex_count)
    )
    border = np.zeros(vertex_count, bool)
    border[edges[count == 1].ravel()] = True
    rows, cols = np.concatenate([edges, edges[:, ::-1]]).T
    on_border = np.concatenate([count == 1, count == 1])
    keep = np.where(border[rows], on_border, True)
    ring = coo_matrix(
        (np.ones(int(keep.sum())), (rows[keep], cols[keep])), shape=(vertex_count, vertex_count)
    ).tocsr()
    valence = np.maximum(np.asarray(ring.sum(1)).ravel(), 1.0)
    share = np.where(border, 1 / 4, 3 / 8 + 0 * valence)
    share = np.where(border, 1 / 4, 5 / 8 - (3 / 8 + np.cos(2 * np.pi / valence) / 4) ** 2)
    even = diags(1 - share) + diags(share / valence) @ ring
    return csr_matrix(vstack([even, ends + wings]))


def _midpoint_matrix(vertex_count: int, edges: Ints) -> csr_matrix:
    from scipy.sparse import coo_matrix, csr_matrix, identity, vstack

    ids = np.repeat(np.arange(len(edges)), 2)
    middle = coo_matrix(
        (np.full(len(ids), 0.5), (ids, edges.ravel())), shape=(len(edges), vertex_count)
    )
    return csr_matrix(vstack([identity(vertex_count), middle]))


def _split_matrix(vertex_count: int, faces: Ints, rounded: bool) -> tuple[Ints, csr_matrix]:
    edges, side_edge, count = _edges(faces)
    a, b, c = faces.T
    ab, bc, ca = (side_edge + vertex_count).T
    new_faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], 1).reshape(-1, 3)
    if rounded:
        return new_faces, _loop_matrix(vertex_count, faces, edges, side_edge, count)
    return new_faces, _midpoint_matrix(vertex_count, edges)


def subdivide(patch: Patch, times: int = 1) -> Patch:
    """Each triangle in four, ``times`` over, positions by Loop's rule (C. Loop, 1987), texture
    corners and bone weights linearly.
    """
    from scipy.sparse import csr_matrix

    for _ in range(times):
        faces, rounded = _split_matrix(len(patch.vertices), patch.faces, rounded=True)
        uv_faces, middle = _split_matrix(len(patch.uv), patch.uv_faces, rounded=False)
        patch = Patch(
            rounded @ patch.vertices,
            faces,
            csr_matrix(rounded @ patch.weights),
            middle @ patch.uv,
            uv_faces,
        )
    return patch


def compact(patch: Patch, keep: NDArray[np.bool_]) -> Patch:
    """The kept faces (mask over F) with only the vertices and texture corners they use."""
    used, faces = np.unique(patch.faces[keep], return_inverse=True)
    used_uv, uv_faces = np.unique(patch.uv_faces[keep], return_inverse=True)
    return Patch(
        patch.vertices[used],
        faces.reshape(-1, 3),
        patch.weights[used],
        patch.uv[used_uv],
        uv_faces.reshape(-1, 3),
    )


def _clip_side(faces: Ints, inside: NDArray[np.bool_], cut: dict[tuple[int, int], int]) -> Ints:
    """Triangles on the inside; ``cut``: the new corner of a crossed (inside, outside) edge."""
    out: list[tuple[int, int, int]] = []
    for face in faces.tolist():
        kept = [bool(inside[v]) for v in face]
        start = kept.index(True) if sum(kept) == 1 else kept.index(False)
        a, b, c = face[start], face[(start + 1) % 3], face[(start + 2) % 3]
        if sum(kept) == 1:
            out.append((a, cut[a, b], cut[a, c]))
        else:
            out += [(cut[b, a], b, c), (cut[b, a], c, cut[c, a])]
    return np.array(out, np.int64).reshape(-1, 3)


def clip(patch: Patch, field: Floats) -> Patch:
    """The part where a per-vertex ``field`` (V,) is positive, cut exactly at its zero line.

    Crossed triangles are split, so that the new border is a smooth curve instead of a staircase.
    """
    from scipy.sparse import coo_matrix, csr_matrix, identity, vstack

    # A vertex exactly on the line would make zero-area slivers.
    field = np.where(np.abs(field) < 1e-7, 1e-7, field)
    positive = field > 0
    count = positive[patch.faces].sum(1)
    crossed = (count == 1) | (count == 2)

    def extend(faces: Ints, owner: Ints, size: int) -> tuple[Ints, csr_matrix]:
        inside = positive[owner]
        sides = faces[crossed][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        sides = sides[inside[sides[:, 0]] != inside[sides[:, 1]]]
        sides = np.unique(np.where(inside[sides[:, :1]], sides, sides[:, ::-1]), axis=0)
        share = field[owner[sides[:, 0]]] / (field[owner[sides[:, 0]]] - field[owner[sides[:, 1]]])
        rows = np.repeat(np.arange(len(sides)), 2)
        values = np.stack([1 - share, share], 1).ravel()
        new = coo_matrix((values, (rows, sides.ravel())), shape=(len(sides), size))
        names = {(int(a), int(b)): size + i for i, (a, b) in enumerate(sides)}
        split = _clip_side(faces[crossed], inside, names)
        return np.concatenate([faces[count == 3], split]), csr_matrix(vstack([identity(size), new]))

    owner = np.zeros(len(patch.uv), np.int64)
    owner[patch.uv_faces.ravel()] = patch.faces.ravel()
    faces, matrix = extend(patch.faces, np.arange(len(patch.vertices)), len(patch.vertices))
    uv_faces, uv_matrix = extend(patch.uv_faces, owner, len(patch.uv))
    clipped = Patch(
        matrix @ patch.vertices,
        faces,
        csr_matrix(matrix @ patch.weights),
        uv_matrix @ patch.uv,
        uv_faces,
    )
    return compact(clipped, np.ones(len(faces), bool))


def vertex_normals(vertices: Floats, faces: Ints) -> Floats:
    """Area-weighted unit normals (V,3) of the vertices."""
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(area[:, axis], 3), minlength=len(vertices))
            for axis in range(3)
        ],
        axis=1,
    )
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def smooth(values: Floats, faces: Ints, times: int, share: float = 0.5) -> Floats:
    """Values (V,K) after ``times`` steps towards the mean of their neighbours; borders are held."""
    from scipy.sparse import coo_matrix, diags

    size = len(values)
    edges, _, count = _edges(faces)
    rows, cols = np.concatenate([edges, edges[:, ::-1]]).T
    ring = coo_matrix((np.ones(len(rows)), (rows, cols)), shape=(size, size)).tocsr()
    mean = diags(1 / np.maximum(np.asarray(ring.sum(1)).ravel(), 1)) @ ring
    free = np.full((size, 1), share)
    free[edges[count == 1].ravel()] = 0.0
    for _ in range(times):
        values = values + free * (mean @ values - values)
    return values
