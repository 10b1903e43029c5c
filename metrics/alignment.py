"""The alignment stage: what moves a prediction before it is measured, and what that takes away."""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.protocol_stages import UNALIGNED, Aligned, Alignment
from harness.core.units import MM_PER_METRE
from harness.geometry.coinciding import merged_positions
from harness.geometry.surface import SurfaceIndex

#: So many vertices, about, tell what an alignment took away.
_LOOKED_AT = 5000


def aligned(predicted: Mesh, truth: SurfaceIndex, how: Alignment) -> Aligned:
    """What an alignment does to a prediction; the identity where nothing is aligned.

    Args:
        predicted: Metres, as given.
        truth: In the same frame.
        how: See ``Alignment``.

    Raises:
        DataError: the prediction is too far off to be moved.
    """
    if how.by == "none":
        return UNALIGNED
    rounds, vertices = 0, readers_vertices(predicted)
    if how.by == "icp":
        matrix, rounds = icp(vertices, readers_vertices(truth.mesh), how)
    else:
        matrix = _box_onto_box(predicted.bounds, truth.mesh.bounds, heights=how.by == "height")
    if not np.isfinite(matrix).all():
        raise DataError(f"{predicted.source} cannot be aligned", got=str(matrix.tolist()))
    turned = np.linalg.det(matrix[:3, :3])
    some = vertices[:: max(1, len(vertices) // _LOOKED_AT)]
    moved = some @ matrix[:3, :3].T + matrix[:3, 3]
    return Aligned(
        by=how.by,
        matrix=tuple(tuple(map(float, row)) for row in matrix),
        scale=float(np.cbrt(abs(turned))),
        mirrored=bool(turned < 0),
        rounds=rounds,
        before_mm=float(truth.closest(some)[1].mean()) * MM_PER_METRE,
        after_mm=float(truth.closest(moved)[1].mean()) * MM_PER_METRE,
    )


def readers_vertices(mesh: Mesh) -> Floats:
    """(V, 3) vertices as trimesh reads them: used ones, one at each position.

    At a seam of the texture each side has its own, which therefore counts twice in an alignment.
    """
    if mesh.uv is None or mesh.face_uv is None:
        used = np.zeros(len(mesh.vertices), dtype=bool)
        used[mesh.faces] = True
        vertices = mesh.vertices[used]
        return vertices[np.unique(merged_positions(vertices), return_index=True)[1]]
    group = merged_positions(mesh.vertices)[mesh.faces].ravel().astype(np.int64)
    coordinates = merged_positions(mesh.uv)[mesh.face_uv].ravel().astype(np.int64)
    pairs = group * (int(coordinates.max()) + 1) + coordinates
    corners = np.unique(pairs, return_index=True)[1]
    return mesh.vertices[mesh.faces.ravel()[corners]]


def icp(moving: Floats, fixed: Floats, how: Alignment) -> tuple[Floats, int]:
    """The (4, 4) matrix that iterative closest points find from the given place, and the rounds.

    As trimesh does it: every moving point goes with its nearest fixed one, both sets weigh evenly,
    and the search stops when the mean squared distance improves by less than the threshold.

    Args:
        moving: (N, 3).
        fixed: (M, 3).
        how: Whether size and handedness may change, and when to stop.
    """
    from scipy.spatial import KDTree

    tree, matrix, cost, rounds = KDTree(fixed), np.eye(4), np.inf, 0
    while rounds < how.iterations:
        targets = fixed[tree.query(moving, workers=-1)[1]]
        step = similarity(moving, targets, scale=how.scale, reflection=how.reflection)
        moving = moving @ step[:3, :3].T + step[:3, 3]
        matrix = step @ matrix
        rounds += 1
        before, cost = cost, float(((targets - moving) ** 2).sum(axis=1).mean())
        if before - cost < how.threshold:
            break
    return matrix, rounds


def similarity(moving: Floats, fixed: Floats, *, scale: bool, reflection: bool) -> Floats:
    """The (4, 4) matrix that brings (N, 3) points onto (N, 3) others, by trimesh's Procrustes.

    Its scale is the ratio of the two sizes, not the one of least squares.
    """
    middle, target = moving.mean(axis=0), fixed.mean(axis=0)
    left, _, right = np.linalg.svd((fixed - target).T @ (moving - middle))
    if not reflection:
        left[:, 2] *= np.linalg.det(left @ right)
    size = np.sqrt(((fixed - target) ** 2).sum() / ((moving - middle) ** 2).sum()) if scale else 1.0
    matrix = np.eye(4)
    matrix[:3, :3] = size * (left @ right)
    matrix[:3, 3] = target - matrix[:3, :3] @ middle
    return matrix


def _box_onto_box(mine: Floats, true: Floats, *, heights: bool) -> Floats:
    sides = [bounds[1] - bounds[0] for bounds in (mine, true)]
    size = sides[1][1] / sides[0][1] if heights else sides[1].max() / sides[0].max()
    matrix = np.diag([size, size, size, 1.0])
    matrix[:3, 3] = true.mean(axis=0) - size * mine.mean(axis=0)
    return matrix
