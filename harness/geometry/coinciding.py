"""How faces hang together: edges, pieces, whether closed; and what lies at one place."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness.core.arrays import AnyInts, Floats, Ints, Ints32, Mask, box_of
from harness.core.mesh import Mesh

#: Of the longest side of a mesh: some steps of float32, as far as files and nodes round.
_ROUNDED = 2.0**-20
#: Directions without meaning; along one, few vertices of a surface lie as near as at one place.
_DIRECTIONS = np.array([[0.48, 0.6, 0.64], [-0.64, 0.768, 0.024], [0.6, 0.0, -0.8]])
#: More vertices than this about each other are no seams, but a mesh that is smaller than it rounds.
_MOST_ALIKE = 64
#: Of its area: faces that add up to more as vectors are a sheet rather than a hull with holes.
_OPEN = 0.5
#: Odd numbers that mix three indices into one.
_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)


def merged_positions(vertices: Floats) -> Ints:
    """(V,) a number for each of (V, D) points, equal where, and only where, positions are equal.

    Texture seams and face-by-face formats split vertices; by position they are one again.
    """
    order = np.lexsort(vertices.T[::-1])
    is_new = np.zeros(len(vertices), dtype=np.int64)
    ordered = vertices[order]
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group = np.empty(len(vertices), dtype=np.int64)
    group[order] = np.cumsum(is_new)
    return group


def coinciding_positions(vertices: Floats, faces: AnyInts, merged: Ints | None = None) -> Ints:
    """(V,) as ``merged_positions``, but one number also for what is apart by rounding alone.

    That is, by less than a millionth of the mesh. Two vertices inside one piece of the surface stay
    two, however near, as do the ends of an edge. ``merged`` is what ``merged_positions`` finds, if
    that is known.
    """
    group = merged_positions(vertices) if merged is None else merged
    places = np.empty((int(group.max()) + 1, 3))
    places[group] = vertices
    used = np.unique(group[faces])
    pairs = used[_near_pairs(places[used])]
    if not len(pairs):
        return group
    # Only faces at these have edges that matter.
    corners = group[faces]
    is_near = np.zeros(len(places), dtype=bool)
    is_near[pairs] = True
    edges = edges_of(corners[is_near[corners].any(axis=1)])
    count = len(places)
    keys = np.sort(pairs, axis=1) @ (count, 1)
    pairs = pairs[~np.isin(keys, edges.ends @ (count, 1))]
    if not len(pairs):
        return group
    first, second = pairs.T
    is_border = np.zeros(count, dtype=bool)
    is_border[edges.ends[edges.counts == 1]] = True
    piece = components(count, *half_edges(corners))
    may = is_border[first] | is_border[second] | (piece[first] != piece[second])
    return components(count, first[may], second[may]).astype(np.int64)[group]


def _near_pairs(points: Floats) -> Ints:
    """(P, 2) points (N, 3), all different, that are apart by rounding alone."""
    from scipy.spatial import KDTree

    reach = _ROUNDED * float(np.ptp(box_of(points), axis=0).max())
    left = np.arange(len(points))
    for direction in _DIRECTIONS:
        along = points[left] @ direction
        order = np.argsort(along)
        close = np.diff(along[order]) <= 1.01 * reach
        near = np.zeros(len(left), dtype=bool)
        near[:-1] |= close
        near[1:] |= close
        left = left[order[near]]
    if not len(left):
        return np.zeros((0, 2), np.int64)
    tree = KDTree(points[left])
    if tree.count_neighbors(tree, reach) > _MOST_ALIKE * len(left):
        return np.zeros((0, 2), np.int64)
    return left[tree.query_pairs(reach, output_type="ndarray")]


@dataclass(frozen=True, slots=True, eq=False)
class Doubles:
    """Faces whose corners are those of an earlier face.

    Attributes:
        extra: (F,) whether there is an earlier one.
        turned: (F,) whether it is wound the other way round than the first one.
        vectors: (F, 3) face normals to smooth by: each place counts once, outwards.
    """

    extra: Mask
    turned: Mask
    vectors: Floats


def doubles_of(corners: AnyInts, vectors: Floats, arms: Floats) -> Doubles:
    """Which faces lie where others do.

    Of a surface that is there twice, inside out the second time, one side is taken: as the faces
    around that are there once have it, else the one that encloses a volume. The two sides of an
    open sheet stay, and cancel each other; so do two such faces alone among others, as where a mesh
    was decimated.

    Args:
        corners: (F, 3) a number for each corner, equal where these are one.
        vectors: (F, 3) outward normals of the faces, twice their area long.
        arms: (F, 3) to a corner of each, from the middle of the mesh.
    """
    first, odd = _first_alike(corners)
    extra = first != np.arange(len(corners))
    turned = odd != odd[first]
    if not extra.any():
        return Doubles(extra, turned, vectors)
    opposed = np.zeros(len(corners), dtype=bool)
    opposed[first[turned]] = True
    opposed = opposed[first]
    is_once = np.zeros(int(corners.max()) + 1, dtype=bool)
    is_once[corners[~opposed & vectors.any(axis=1)]] = True
    sheet = opposed & ~is_once[corners].all(axis=1)
    signs = np.zeros(len(corners))
    if sheet.any():
        chosen, kept = np.flatnonzero(~extra), vectors[~extra]
        volumes = np.einsum("ij,ij->i", arms[chosen], kept)
        signs[chosen] = _signs(corners[chosen], kept, volumes, sheet[chosen])
    sheet &= signs[first] != 0
    vectors = np.where(sheet[:, None], vectors * signs[:, None], vectors)
    vectors[extra & ~opposed] = 0.0
    return Doubles(extra, turned, vectors)


def _first_alike(corners: AnyInts) -> tuple[Ints, Mask]:
    """(F,) the first face with the same three corners, and whether their order is an odd one."""
    ordered = np.sort(corners, axis=1)
    odd = ((corners[:, :2] > corners[:, 1:]).sum(axis=1) + (corners[:, 0] > corners[:, 2])) % 2 == 1
    keys = (ordered.astype(np.uint64) * _MIX).sum(axis=1)
    alike = np.sort(keys)
    if (alike[1:] != alike[:-1]).all():
        return np.arange(len(corners)), odd
    order = np.argsort(keys, kind="stable")
    here, before = order[1:], order[:-1]
    same = keys[here] == keys[before]
    same[same] = (ordered[here[same]] == ordered[before[same]]).all(axis=1)
    # A face without area has no side to it.
    same[same] = (ordered[here[same], 1:] != ordered[here[same], :-1]).all(axis=1)
    starts = np.append(0, np.where(same, 0, np.arange(1, len(order))))
    first = np.empty(len(corners), dtype=np.int64)
    first[order] = order[np.maximum.accumulate(starts)]
    return first, odd


def _signs(corners: AnyInts, vectors: Floats, volumes: Floats, free: Mask) -> Floats:
    """(F,) 1 or -1 by which all look outwards if the free ones turn; 0 for open sheets of these."""
    count = len(corners)
    start, end = half_edges(corners)
    edges = edges_of(corners)
    order = np.argsort(edges.of_side, axis=None, kind="stable")
    at = (np.cumsum(edges.counts) - edges.counts)[edges.counts == 2]
    one, two = order[at], order[at + 1]
    clash = (start < end)[one] == (start < end)[two]
    # Each face twice, as it is and turned; those that go together are connected.
    first, second = one // 3, two // 3
    group = components(
        2 * count,
        np.concatenate([first, first + count]),
        np.concatenate([second + count * clash, second + count * ~clash]),
    )
    groups = int(group.max()) + 1
    sizes = np.linalg.norm(vectors, axis=1)
    mine, other = group[:count], group[count:]
    fixed, enclosed, x, y, z = (
        np.bincount(mine, each, groups) - np.bincount(other, each, groups)
        for each in (np.where(free, 0.0, sizes), volumes, *vectors.T)
    )
    whole = np.bincount(mine, sizes, groups) + np.bincount(other, sizes, groups)
    is_open = (fixed == 0) & (np.sqrt(x * x + y * y + z * z) > _OPEN * whole)
    side = np.where(np.where(fixed != 0, fixed, enclosed) >= 0, 1.0, -1.0)
    return np.where(is_open, 0.0, side)[mine]


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
