"""From a source's own world to metres: by the cameras, which are known, never by the surface.

A source that estimates cameras has a world of its own: its first camera, a unit without meaning.
``harness/geometry/similarity.py`` takes its cameras to the known ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.mesh import Mesh
from harness.core.results import PhotoFrame
from harness.geometry.images import resampled
from harness.geometry.similarity import Similarity, point_similarity
from harness.geometry.surface import SurfaceIndex


@dataclass(frozen=True, slots=True, eq=False)
class OrientedPoints:
    """Points of a surface with the side that they face, world metres.

    Attributes:
        positions: (N, 3).
        normals: (N, 3) unit, outwards.
    """

    positions: Floats
    normals: Floats

    def __len__(self) -> int:
        return len(self.positions)

    def chosen(self, keep: Mask) -> OrientedPoints:
        """Those where ``keep`` (N,) holds."""
        return OrientedPoints(self.positions[keep], self.normals[keep])

    @classmethod
    def joined(cls, parts: Sequence[OrientedPoints]) -> OrientedPoints:
        """All parts, one after the other."""
        if not parts:
            return cls(np.zeros((0, 3)), np.zeros((0, 3)))
        return cls(
            np.concatenate([part.positions for part in parts]),
            np.concatenate([part.normals for part in parts]),
        )

    def thinned(self, cell_m: float) -> OrientedPoints:
        """One point for each cell and side: the mean of those that face about the same way.

        The two sides of a thin sheet share a cell but not a direction, and stay apart.
        """
        if cell_m <= 0 or len(self) == 0:
            return self
        cells = np.floor(self.positions / cell_m).astype(np.int64)
        side = ((self.normals > 0) * np.array([1, 2, 4])).sum(axis=1)
        key = np.column_stack([cells, side])
        _, owner = np.unique(key, axis=0, return_inverse=True)
        owner = owner.ravel()
        count = int(owner.max()) + 1
        weight = np.bincount(owner, minlength=count)[:, None]

        def total(values: Floats) -> Floats:
            sums = [np.bincount(owner, axis, count) for axis in values.T]
            return np.stack(sums, axis=1).astype(np.float64)

        normals = total(self.normals)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return OrientedPoints(total(self.positions) / weight, normals / np.maximum(length, 1e-9))


def coverage_in(frame: PhotoFrame, coverage: Floats) -> Floats:
    """A photo's coverage (H, W), on a picture's pixels; 0 where the picture is padded."""
    smaller = frame.resized[0] < frame.photo[0]
    shrunk = resampled(coverage, frame.resized, "box" if smaller else "bilinear")
    (width, height), (left, top) = frame.size, frame.shift
    canvas = np.zeros((height, width), dtype=shrunk.dtype)
    rows = slice(max(top, 0), min(top + frame.resized[1], height))
    columns = slice(max(left, 0), min(left + frame.resized[0], width))
    canvas[rows, columns] = shrunk[
        rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
    ]
    return canvas


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
