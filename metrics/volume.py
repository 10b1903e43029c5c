"""Intersection over union of two bodies: of their volumes, and of their bounding boxes."""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError
from harness.core.results import MetricValue
from harness.core.units import Unit
from harness.geometry.surface import SurfaceIndex

_POINTS, _BATCH = 1_000_000, 250_000
#: Along no axis of a scan or a grid, so that a ray meets edges by chance only.
_DIRECTION = np.array([0.3713, 0.8127, 0.4489]) / np.linalg.norm([0.3713, 0.8127, 0.4489])


def volume_iou(predicted: SurfaceIndex, truth: SurfaceIndex, seed: int) -> MetricValue:
    """Volume that two closed surfaces share over the volume of either, from a million points.

    A point is inside where the surface winds around it: where the crossings of a ray out of the
    surface and into it do not cancel.

    Raises:
        DataError: a surface with a hole has no volume.
    """
    for surface in (predicted, truth):
        check_closed(surface)
    low = np.minimum(predicted.bounds[0], truth.bounds[0])
    high = np.maximum(predicted.bounds[1], truth.bounds[1])
    points = low + np.random.default_rng(seed).random((_POINTS, 3)) * (high - low)
    mine, true = inside(predicted, points), inside(truth, points)
    either = int((mine | true).sum())
    share = float((mine & true).sum() / either) if either else 0.0
    error = float(np.sqrt(share * (1 - share) / either)) if either else 0.0
    return MetricValue(share, Unit.ratio.value, either, error)


def inside(surface: SurfaceIndex, points: Floats) -> Mask:
    """(N,) whether the winding number of a closed surface around (N, 3) points is not 0."""
    found = np.zeros(len(points), dtype=bool)
    could = ((points >= surface.bounds[0]) & (points <= surface.bounds[1])).all(axis=1)
    for chosen in np.array_split(np.flatnonzero(could), -(-len(points) // _BATCH)):
        ray, _, faces, _ = surface.crossings(points[chosen], _DIRECTION)
        outwards = np.sign(surface.face_vectors[faces] @ _DIRECTION)
        found[chosen] = np.bincount(ray, outwards, len(chosen)).round() != 0
    return found


def check_closed(surface: SurfaceIndex) -> None:
    """Refuse a surface with an open edge.

    Raises:
        DataError: the message counts them.
    """
    faces = surface.corners.astype(np.int64)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = edges.min(axis=1), edges.max(axis=1)
    _, which = np.unique(low * (int(high.max()) + 1) + high, return_inverse=True)
    open_edges = np.bincount(which, np.where(edges[:, 0] == low, 1, -1) * (low != high)).round()
    if count := int((open_edges != 0).sum()):
        raise DataError(
            f"{surface.mesh.source} has no volume",
            expected="a closed surface",
            got=f"{count} open edges",
            hint="Distances need no closed surface",
        )


def box_iou(predicted: Floats, truth: Floats) -> float:
    """Intersection over union of two (2, 3) boxes, which some papers print as "IoU"."""
    low, high = np.maximum(predicted[0], truth[0]), np.minimum(predicted[1], truth[1])
    shared = float(np.maximum(high - low, 0.0).prod())
    both = sum(float((box[1] - box[0]).prod()) for box in (predicted, truth))
    return shared / (both - shared + 1e-11)
