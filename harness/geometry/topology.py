"""How the faces of a mesh hang together: its edges, its connected pieces, whether it is closed.

Faces are triangles unless a function says that it takes quads too. Nothing here looks at positions
but ``concatenated``: two vertices at one place are two vertices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness.core.arrays import AnyInts, Ints, Ints32
from harness.core.mesh import Mesh


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """The edges of a surface, each once, whatever the direction in which its faces run along it.

    Attributes:
        ends: (E, 2) vertex indices, the lower first, in ascending order.
        of_side: (F, K) the edge on each side of each face; side k runs from corner k to the next.
        counts: (E,) how many faces have the edge: 2 everywhere on a closed surface.
    """

    ends: Ints
    of_side: Ints
    counts: Ints

    def faces(self) -> Ints:
        """(E, 2) the two faces at each edge; the second is -1 at a border.

        A third face at an edge is left out.
        """
        order = np.argsort(self.of_side, axis=None, kind="stable")
        owner = order // self.of_side.shape[1]
        starts = np.cumsum(self.counts) - self.counts
        following = owner[np.minimum(starts + 1, len(owner) - 1)]
        return np.stack([owner[starts], np.where(self.counts > 1, following, -1)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """The connected pieces of a mesh, numbered by their lowest vertex; P of them.

    A vertex that no face uses is a piece of its own.

    Attributes:
        of_vertex: (V,) the piece of each vertex.
        of_face: (F,) the piece of each face.
        vertex_counts: (P,) vertices of each piece.
        face_counts: (P,) faces of each piece.
    """

    of_vertex: Ints32
    of_face: Ints32
    vertex_counts: Ints
    face_counts: Ints


def half_edges(faces: AnyInts) -> tuple[Ints, Ints]:
    """(F*K,) first and second vertex of each side of triangles or quads (F, K), face after face."""
    corners = faces.astype(np.int64)
    return corners.ravel(), np.roll(corners, -1, axis=1).ravel()


def edges_of(faces: AnyInts) -> Edges:
    """The edges of triangles or quads (F, K)."""
    start, end = half_edges(faces)
    low, high = np.minimum(start, end), np.maximum(start, end)
    count = int(high.max(initial=0)) + 1
    keys, of_side, counts = np.unique(low * count + high, return_inverse=True, return_counts=True)
    ends = np.stack([keys // count, keys % count], axis=1)
    return Edges(ends, of_side.reshape(faces.shape), counts)


def components(count: int, first: ArrayLike, second: ArrayLike) -> Ints32:
    """(count,) the group of each of ``count`` things, numbered by the lowest member.

    Args:
        count: Number of things.
        first: (P,) one of each pair of things that hang together.
        second: (P,) the other.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.asarray(first), np.asarray(second)
    graph = coo_array((np.ones(len(pairs[0]), dtype=bool), pairs), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def pieces_of(faces: AnyInts, vertex_count: int) -> Pieces:
    """The connected pieces of triangles or quads (F, K) on ``vertex_count`` vertices."""
    of_vertex = components(vertex_count, *half_edges(faces))
    of_face = of_vertex[faces[:, 0]]
    vertex_counts = np.bincount(of_vertex)
    return Pieces(
        of_vertex, of_face, vertex_counts, np.bincount(of_face, minlength=len(vertex_counts))
    )


def largest_piece(mesh: Mesh) -> Mesh:
    """The piece with the most vertices, without vertices that no face uses."""
    pieces = pieces_of(mesh.faces, len(mesh.vertices))
    return mesh.submesh(pieces.of_face == pieces.vertex_counts.argmax())


def open_edges(mesh: Mesh) -> int:
    """How many edges do not join exactly two faces that run along it in opposite directions.

    Zero means watertight, consistently oriented, and never more than two faces at an edge.
    """
    start, end = half_edges(mesh.faces)
    count = len(mesh.vertices)
    there, times = np.unique(start * count + end, return_counts=True)
    unmatched = np.setxor1d(there, np.unique(end * count + start), assume_unique=True)
    return int((times > 1).sum()) + len(unmatched)


def concatenated(parts: Sequence[Mesh]) -> Mesh:
    """All parts in one mesh without texture, their vertices one after the other; not joined."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate(
            [part.faces + start for part, start in zip(parts, starts, strict=False)]
        ),
        source=" + ".join(part.source for part in parts),
    )
