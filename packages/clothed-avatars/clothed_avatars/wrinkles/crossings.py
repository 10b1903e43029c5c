"""Where a garment passes through itself, and wrinkles taken back until they no longer do."""

from __future__ import annotations

from typing import Any

import numpy as np

from clothed_avatars.mesh.quads import Floats, Ints, SparseMatrix, triangles
from harness.core.arrays import Mask
from harness.geometry.coinciding import edges_of

_END = 0.02
"""Share of an edge's length at either end that does not count: its neighbours touch it there."""
_ROUNDS = 3
_SPREAD = 10
_TAKEN_BACK = 0.7


def _crossings(vertices: Floats, quads: Ints) -> tuple[Ints, Ints]:
    """(C,2) edges that pass through a triangle they are no part of, and (C,3) those triangles."""
    import open3d as o3d

    faces = triangles(quads)
    tensor: Any = o3d.core.Tensor
    scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(tensor(vertices.astype(np.float32)), tensor(faces.astype(np.uint32)))
    ends = edges_of(quads).ends
    ends = ends[ends[:, 0] != ends[:, 1]]
    start = vertices[ends[:, 0]]
    way = vertices[ends[:, 1]] - start
    rays = np.concatenate([start + _END * way, way], axis=1).astype(np.float32)
    answer = scene.cast_rays(tensor(rays), nthreads=1)
    # Distances are counted in lengths of the direction, which is the edge itself.
    met = answer["t_hit"].numpy() < 1 - 2 * _END
    edge, face = ends[met], faces[answer["primitive_ids"].numpy()[met].astype(np.int64)]
    apart = (edge[:, :, None] != face[:, None, :]).all((1, 2))
    return edge[apart], face[apart]


def crossing_vertices(vertices: Floats, quads: Ints) -> Mask:
    """(V,) vertices of edges that pass through the surface, and of the triangles they pass."""
    edge, face = _crossings(vertices, quads)
    out = np.zeros(len(vertices), bool)
    out[edge.ravel()] = True
    out[face.ravel()] = True
    return out


def crossing_share(vertices: Floats, quads: Ints) -> float:
    """The share of a garment's edges that pass through it."""
    edge, _ = _crossings(vertices, quads)
    return len(edge) / len(edges_of(quads).ends)


def uncrossed(draped: Floats, moved: Floats, quads: Ints, means: SparseMatrix) -> Floats:
    """Displacements (V,3) of a drape (V,3), smaller around places where the cloth crosses itself.

    What the drape itself crosses stays: taking wrinkles back does not help there.
    """
    already = crossing_vertices(draped, quads)
    for _ in range(_ROUNDS):
        crossed = crossing_vertices(draped + moved, quads) & ~already
        if not crossed.any():
            break
        near = crossed.astype(float)
        for _ in range(_SPREAD):
            near = np.maximum(near, means @ near)
        moved = moved * (1 - _TAKEN_BACK * near)[:, None]
    return moved
