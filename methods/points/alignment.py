"""From a source's own world to metres: by the cameras, which are known, never by the surface.

A source that estimates cameras has a world of its own: its first camera, a unit without meaning.
``harness/geometry/similarity.py`` takes its cameras to the known ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.mesh import Mesh
from harness.geometry.similarity import Similarity, point_similarity
from harness.geometry.surface import SurfaceIndex
from methods.points.cloud import OrientedPoints

#: How a source's world becomes the harness's, as a setting says it.
#: ``sim3_cameras``: depth and cameras as estimated, moved by one similarity for all views.
#: ``known_cameras``: the estimated depth in the known cameras; only its scale is from the former.
#: ``native_posed``: the source worked with the known cameras itself.
#: ``oracle_icp``: as the first, then moved onto the scan: a privilege, and never ranked.
#: ``protocol``: left in the source's own world; the metric protocol's alignment is all there is.
ALIGNMENTS = ("sim3_cameras", "known_cameras", "native_posed", "oracle_icp", "protocol")

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
