"""Points that two views agree on: what one depth map says and the other confirms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from methods.stereo.membrane import unit
from methods.stereo.patchmatch import DepthMap
from methods.stereo.settings import KeepRules

#: Points average with weights 1 / (this + cost).
_COST_SOFTENING = 0.02
_ISOLATED_NEIGHBOURS = 6


@dataclass(frozen=True, slots=True, eq=False)
class StereoPoints:
    """Oriented points that photos agree on, world metres.

    Attributes:
        positions: (N, 3).
        normals: (N, 3) unit, outwards.
        score: (N,) correlation of the patch with the neighbouring photos.
        view: (N,) whose depth map each comes from.
    """

    positions: Floats
    normals: Floats
    score: Floats
    view: Ints

    def __len__(self) -> int:
        return len(self.positions)

    def chosen(self, keep: Mask) -> StereoPoints:
        """Those where ``keep`` (N,) holds."""
        return StereoPoints(
            self.positions[keep], self.normals[keep], self.score[keep], self.view[keep]
        )

    def away_from(self, places: Floats, least_m: float) -> StereoPoints:
        """Those that are further than ``least_m`` from all places (M, 3), world metres."""
        from scipy.spatial import KDTree

        if len(self) == 0 or len(places) == 0:
            return self
        # Farther places need no search: a distance beyond the bound is infinite.
        distance, _ = KDTree(places).query(self.positions, distance_upper_bound=2 * least_m)
        return self.chosen(np.asarray(distance) > least_m)


def consistent_points(
    maps: Mapping[int, DepthMap], rules: KeepRules, pixel_m: float
) -> StereoPoints:
    """The points that the map of a neighbour confirms, thinned view by view, without lone ones.

    Views are thinned each by itself, so that those of different views stay apart as evidence of
    their own.

    Args:
        maps: By view.
        rules: What is kept.
        pixel_m: What a pixel of the maps spans of the subject.
    """
    cell_m, near_m = max(rules.cell_m, pixel_m), max(rules.isolated_m, 4.0 * pixel_m)
    kept = [_thinned(_confirmed(view, maps, rules), cell_m) for view in sorted(maps)]
    return _not_alone(joined(kept), near_m)


def _confirmed(view: int, maps: Mapping[int, DepthMap], rules: KeepRules) -> StereoPoints:
    """The points of one map that at least one of its sources' maps holds too."""
    own = maps[view]
    good = own.searched & (own.cost < 1.0 - rules.correlation)
    rows, columns = np.nonzero(good & (own.sharpness > rules.sharpness))
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
    points = own.camera.unproject(pixels, own.depth[rows, columns])
    normals = unit(own.normal[rows, columns] @ own.camera.rotation)
    confirmed = np.zeros(len(rows), dtype=bool)
    for source in own.sources:
        if source in maps:
            confirmed |= _agrees(points, normals, maps[source], rules)
    found = StereoPoints(
        points, normals, 1.0 - own.cost[rows, columns].astype(np.float64), np.full(len(rows), view)
    )
    return found.chosen(confirmed)


def _agrees(points: Floats, normals: Floats, other: DepthMap, rules: KeepRules) -> Mask:
    """(N,) whether another map's plane passes the points, facing the same way."""
    height, width = other.depth.shape
    pixels, depth = other.camera.project(points)
    columns = np.clip(np.nan_to_num(pixels[:, 0]).astype(np.int64), 0, width - 1)
    rows = np.clip(np.nan_to_num(pixels[:, 1]).astype(np.int64), 0, height - 1)
    plane = other.normal[rows, columns].astype(np.float64)
    centre = np.stack([columns + 0.5, rows + 0.5], axis=1)
    # The other plane's depth at the very place, not at the centre of its pixel.
    back = np.linalg.inv(other.camera.K).T
    at_centre = np.einsum("ij,ij->i", plane, np.column_stack([centre, np.ones(len(rows))]) @ back)
    at_place = np.einsum("ij,ij->i", plane, np.column_stack([pixels, np.ones(len(rows))]) @ back)
    theirs = other.depth[rows, columns] * at_centre / np.minimum(at_place, -1e-3)
    same_way = np.einsum("ij,ij->i", plane @ other.camera.rotation, normals)
    return (
        other.searched[rows, columns]
        & (other.cost[rows, columns] < 1.0 - rules.neighbour_correlation)
        & (np.abs(theirs - depth) < rules.depth_m)
        & (same_way > np.cos(np.radians(rules.angle_deg)))
    )


def _thinned(points: StereoPoints, cell_m: float) -> StereoPoints:
    """One point a cell: the mean of the cell's, the better correlated counting more."""
    if len(points) == 0:
        return points
    cells = np.floor(points.positions / cell_m).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    cell = cell.ravel()
    count = int(cell.max()) + 1
    weights = 1.0 / (_COST_SOFTENING + 1.0 - points.score)
    total = np.bincount(cell, weights, count)

    def mean(values: Floats) -> Floats:
        sums: list[Any] = [np.bincount(cell, weights * axis, count) for axis in values.T]
        return np.stack(sums, axis=1)

    return StereoPoints(
        positions=mean(points.positions) / total[:, None],
        normals=unit(mean(points.normals)),
        score=np.bincount(cell, weights * points.score, count) / total,
        view=np.full(count, points.view[0]),
    )


def _not_alone(points: StereoPoints, near_m: float) -> StereoPoints:
    from scipy.spatial import KDTree

    if len(points) <= _ISOLATED_NEIGHBOURS:
        return points.chosen(np.zeros(len(points), dtype=bool))
    tree = KDTree(points.positions)
    distance, _ = tree.query(
        points.positions, k=_ISOLATED_NEIGHBOURS, distance_upper_bound=2 * near_m
    )
    return points.chosen(distance[:, -1] < near_m)


def joined(parts: Sequence[StereoPoints]) -> StereoPoints:
    """All points of some sets, one set after the other."""
    if not parts:
        return StereoPoints(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64))
    return StereoPoints(
        positions=np.concatenate([part.positions for part in parts]),
        normals=np.concatenate([part.normals for part in parts]),
        score=np.concatenate([part.score for part in parts]),
        view=np.concatenate([part.view for part in parts]),
    )
