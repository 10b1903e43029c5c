"""``oracle_icp``: points moved onto the scan itself; a diagnosis under a privilege, never ranked.

What is left after it is the shape's own error; what it takes away was the alignment's.
Source: Besl and McKay, "A method for registration of 3-D shapes", PAMI 1992, with a scale and
without the worst pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.mesh import Mesh
from harness.geometry.surface import SurfaceIndex
from methods.points.alignment import Similarity, point_similarity
from methods.points.cloud import OrientedPoints

#: Points that are asked, evenly chosen; rounds; and the share of pairs that count, nearest first.
_ASKED, _ROUNDS, _COUNTED = 20_000, 40, 0.8
_ENOUGH_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """Points after they were moved.

    Attributes:
        points: In their new place.
        similarity: By which they got there.
    """

    points: OrientedPoints
    similarity: Similarity

    def details(self) -> dict[str, object]:
        """What a record says of it."""
        cosine = (np.trace(self.similarity.rotation) - 1.0) / 2.0
        return {
            "icp_scale": round(self.similarity.scale, 6),
            "icp_angle_deg": round(float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))), 4),
        }


def moved_onto(points: OrientedPoints, truth: Mesh) -> Moved:
    """The points after the similarity that brings them closest to a surface, world metres."""
    index = SurfaceIndex(truth)
    step = max(1, len(points) // _ASKED)
    start = points.positions[::step]
    total = Similarity(1.0, np.eye(3), np.zeros(3))
    for _ in range(_ROUNDS):
        now = total.points(start)
        found, distance = index.closest(now)
        near = distance <= np.quantile(distance, _COUNTED)
        further = point_similarity(now[near], found.points[near])
        total = total.then(further)
        if np.abs(further.points(now) - now).max() < _ENOUGH_M:
            break
    return Moved(
        OrientedPoints(total.points(points.positions), points.normals @ total.rotation.T), total
    )
