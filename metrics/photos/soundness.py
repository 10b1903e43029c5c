"""Whether a mesh is closed, and how many of its faces cross each other.

Two triangles that share no corner, and do not lie in one plane, cross exactly where an edge of one
goes through the other. So every edge is a short ray: Embree finds those that meet anything between
their ends, and these few are then tested exactly, in double precision, against what they meet. A
crossing that is shallower than float32 resolves, about a tenth of a micrometre on a person, is not
seen; faces that lie in one plane and overlap do not count.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.mesh import Mesh
from harness.core.quality.photo_scores import Soundness
from harness.geometry.coinciding import merged_positions
from harness.geometry.topology import Edges, edges_of, half_edges

#: An edge is cast without so much of it at either end, where it meets its neighbours.
_END_SHARE = 1e-4
_BATCH = 1 << 20


def soundness(mesh: Mesh) -> Soundness:
    """Open edges and self-intersections of a mesh; vertices at one place count as one."""
    joined = _joined(mesh)
    return Soundness(
        faces=len(mesh.faces),
        open_edges=_open_edges(joined),
        self_intersecting_faces=int(self_intersecting(joined).sum()),
    )


def self_intersecting(mesh: Mesh) -> Mask:
    """(F,) whether a face is crossed by an edge that shares no vertex with it, or has such an edge.

    Vertices at one place count as one.
    """
    joined = _joined(mesh)
    points = joined.vertices - joined.bounds.mean(axis=0)
    edges = edges_of(joined.faces)
    pairs = _met(points, joined.faces, edges)
    crossing = _crosses(points, edges.ends[pairs[:, 0]], joined.faces[pairs[:, 1]])
    found = np.zeros(len(mesh.faces), dtype=bool)
    found[pairs[crossing, 1]] = True
    crossed = np.zeros(len(edges.ends), dtype=bool)
    crossed[pairs[crossing, 0]] = True
    return found | crossed[edges.of_side].any(axis=1)


def _joined(mesh: Mesh) -> Mesh:
    place = merged_positions(mesh.vertices)
    positions = np.empty((int(place.max()) + 1, 3))
    positions[place] = mesh.vertices
    return Mesh(positions, place[mesh.faces], source=mesh.source)


def _open_edges(joined: Mesh) -> int:
    """How many edges do not join exactly two faces that run along it in opposite directions."""
    edges = edges_of(joined.faces)
    start, end = half_edges(joined.faces)
    direction = np.where(start < end, 1, -1)
    net = np.bincount(edges.of_side.ravel(), direction, len(edges.counts))
    return int(((edges.counts != 2) | (net != 0)).sum())


def _met(points: Floats, faces: Any, edges: Edges) -> Ints:
    """(P, 2) edge and face, where an edge may meet a face that has neither of its ends."""
    import open3d as o3d

    tensor: Any = o3d.core.Tensor
    scene: Any = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(points.astype(np.float32)), tensor(faces.astype(np.uint32)))
    start = points[edges.ends[:, 0]]
    rays = np.concatenate([start, points[edges.ends[:, 1]] - start], axis=1).astype(np.float32)
    blocked = np.concatenate(
        [
            scene.test_occlusions(tensor(part), tnear=_END_SHARE, tfar=1.0 - _END_SHARE).numpy()
            for part in np.array_split(rays, -(-len(rays) // _BATCH))
        ]
    )
    waiting = np.flatnonzero(blocked)
    if not len(waiting):
        return np.zeros((0, 2), dtype=np.int64)
    answer = scene.list_intersections(tensor(rays[waiting]))
    share = answer["t_hit"].numpy()
    within = (share > 0) & (share < 1)
    edge = waiting[answer["ray_ids"].numpy()[within]]
    face = answer["primitive_ids"].numpy()[within].astype(np.int64)
    ends, corners = edges.ends[edge], faces[face]
    apart = (ends[:, :, None] != corners[:, None, :]).all(axis=(1, 2))
    return np.stack([edge[apart], face[apart]], axis=1)


def _crosses(points: Floats, ends: Ints, corners: Any) -> Mask:
    """(P,) whether segments, by the indices of their ends, go through triangles."""
    first, last = points[ends[:, 0]], points[ends[:, 1]]
    a, b, c = (points[corners[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    before, behind = _dot(first - a, normal), _dot(last - a, normal)
    along = last - first
    # On which side of the segment's line each side of the triangle runs: all alike if it is met.
    turns = [_dot(along, np.cross(p - first, q - first)) for p, q in ((a, b), (b, c), (c, a))]
    inside = np.all([turn >= 0 for turn in turns], axis=0) | np.all(
        [turn <= 0 for turn in turns], axis=0
    )
    return inside & (before * behind < 0)


def _dot(first: Floats, second: Floats) -> Floats:
    return np.einsum("ij,ij->i", first, second)
