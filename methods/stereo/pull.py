"""A closed surface, pulled to the points that photos agree on.

A Poisson surface of the points themselves is rough (normals 20 to 27 degrees off) and open where no
view agrees; a closed surface that is moved keeps what it has where nothing is known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster
from methods.stereo.membrane import Agreement, Neighbourhood, agreement, unit
from methods.stereo.patchmatch import DepthMap
from methods.stereo.settings import KeepRules, PullRound

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
    if other.camera.is_orthographic:
        theirs = other.depth[rows, columns] + (at_centre - at_place) / np.minimum(
            plane[:, 2], -1e-3
        )
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


#: A new mesh of a closed surface with edges of about so many metres.
Remesh = Callable[[Mesh, float], Mesh]

#: A point belongs to a face whose normal is no further from its own (cosine).
_SAME_WAY = 0.3
_SMOOTHINGS = 4
#: Points whose offset differs from the mean at a vertex by more than this do not count there.
_TRIM_M, _TRIM_SHARE, _TRIMS = 0.004, 0.35, 2
#: A vertex needs points of at least this weight in all; a whole point at a vertex has weight 1.
_LEAST_WEIGHT = 0.3
#: A vertex whose offset differs by more from its neighbourhood's is an outlier.
_LONE_M, _LONE_SPREAD, _LONE_LEAST = 0.005, 6, 0.1
#: A patch of offsets, with jumps or nothing around it, is not believed where it is smaller than
#: 15 cm2 and offsets exceed 4 mm: a pattern that repeats has such islands one period too deep. On
#: three training subjects (``paper8``), 14, 29 and 44 % of their area was nearer to the scan.
_ISLAND_M2, _ISLAND_M = 15e-4, 0.004


@dataclass(frozen=True, slots=True)
class RoundReport:
    """What one round did.

    Attributes:
        vertices: Share of the vertices that had points.
        believed: How far the offsets were believed on the whole, 0 to 1.
        error_m: Standard deviation of one group of views' offsets.
        moved_m: Root mean square of the motion.
    """

    vertices: float
    believed: float
    error_m: float
    moved_m: float


def round_report(known: Floats, agreed: Agreement, motion: Floats) -> RoundReport:
    """What a round did that moved vertices (V,) by ``motion`` where ``known`` is above zero."""
    return RoundReport(
        vertices=float((known > 0).mean()),
        believed=agreed.overall,
        error_m=agreed.error_m,
        moved_m=float(np.sqrt((motion**2).mean())),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Pulled:
    """The surface after the rounds, and what each did."""

    mesh: Mesh
    rounds: tuple[RoundReport, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Contacts:
    """Points on their way to the mesh: the (N, 3) corners of the faces they meet, the weights of
    these, how far each point lies from the mesh along the corners' directions, and its group.
    """

    corners: Ints
    weights: Floats
    offsets: Floats
    group: Mask


def pull(mesh: Mesh, points: StereoPoints, rounds: Sequence[PullRound], remesh: Remesh) -> Pulled:
    """The mesh moved to the points, coarse to fine.

    Args:
        mesh: Closed, facing outwards, world metres.
        points: What photos agree on.
        rounds: One after the other.
        remesh: Makes the new mesh between rounds.
    """
    reports = []
    for settings in rounds:
        mesh, report = _round(mesh, points, settings)
        reports.append(report)
        if settings.remesh_m:
            mesh = remesh(mesh, settings.remesh_m)
    return Pulled(mesh, tuple(reports))


def _round(mesh: Mesh, points: StereoPoints, settings: PullRound) -> tuple[Mesh, RoundReport]:
    around = Neighbourhood(mesh)
    directions = around.smooth_normals(_SMOOTHINGS)
    contacts = _contacts(mesh, points, directions, settings)
    count = len(mesh.vertices)
    offsets, weight = _trimmed_means(contacts, contacts.weights, count)
    known = np.clip(weight, 0.0, 1.0) * (weight > _LEAST_WEIGHT)
    known *= _with_neighbours(offsets, known, around)
    known *= ~_on_islands(offsets, known, around)
    believed = _held_out(contacts, count, around)
    motion = around.motion(offsets, known * believed.share, settings.membrane_m)
    moved = replace(mesh, vertices=mesh.vertices + motion[:, None] * directions)
    return moved, round_report(known, believed, motion)


def _contacts(
    mesh: Mesh, points: StereoPoints, directions: Floats, settings: PullRound
) -> _Contacts:
    """Where the points' own normals meet the mesh, the nearer of outwards and inwards."""
    caster = Raycaster(mesh)
    way = np.full(len(points), np.inf)
    face = np.zeros(len(points), dtype=np.int64)
    second_third = np.zeros((len(points), 2))
    for sign, reach_m in ((1.0, settings.inward_m), (-1.0, settings.outward_m)):
        answer = caster.answer(points.positions, sign * points.normals)
        distance = answer["t_hit"].numpy()
        normal = answer["primitive_normals"].numpy()
        same_way = np.einsum("ij,ij->i", normal, points.normals) > _SAME_WAY * np.linalg.norm(
            normal, axis=1
        )
        nearer = same_way & (distance < reach_m) & (distance < way)
        way[nearer] = distance[nearer]
        face[nearer] = answer["primitive_ids"].numpy()[nearer]
        second_third[nearer] = answer["primitive_uvs"].numpy()[nearer]
    met = np.flatnonzero(np.isfinite(way))
    corners = mesh.faces[face[met]].astype(np.int64)
    weights = np.column_stack([1.0 - second_third[met].sum(axis=1), second_third[met]])
    places = np.einsum("nk,nkc->nc", weights, mesh.vertices[corners])
    apart = points.positions[met] - places
    offsets = np.einsum("nc,nkc->nk", apart, directions[corners])
    return _Contacts(corners, weights, offsets, points.view[met] % 2 == 0)


def _trimmed_means(contacts: _Contacts, weights: Floats, count: int) -> tuple[Floats, Floats]:
    """(V,) offsets, the mean of the points that agree best, and their (V,) weights."""
    means, total = _means(contacts, weights, count)
    for _ in range(_TRIMS):
        middle = means[contacts.corners]
        limit = np.maximum(_TRIM_M, _TRIM_SHARE * np.abs(middle))
        kept = weights * (np.abs(contacts.offsets - middle) < limit)
        means, total = _means(contacts, kept, count)
    return means, total


def _means(contacts: _Contacts, weights: Floats, count: int) -> tuple[Floats, Floats]:
    at = contacts.corners.ravel()
    total: Any = np.bincount(at, weights.ravel(), count)
    means = np.bincount(at, (weights * contacts.offsets).ravel(), count)
    return means / np.maximum(total, 1e-9), total


def _with_neighbours(offsets: Floats, known: Floats, around: Neighbourhood) -> Mask:
    """(V,) whether an offset is like those beside it."""
    weight = around.averaged(known, _LONE_SPREAD)
    mean = around.averaged(known * offsets, _LONE_SPREAD) / np.maximum(weight, 1e-6)
    return (np.abs(offsets - mean) < _LONE_M) & (weight > _LONE_LEAST)


def _on_islands(offsets: Floats, known: Floats, around: Neighbourhood) -> Mask:
    """(V,) whether an offset is large and shared by a small patch only."""
    areas_m2 = around.patch_areas_m2(offsets, known > 0, _ISLAND_M)
    return (areas_m2 < _ISLAND_M2) & (np.abs(offsets) > _ISLAND_M)


def _held_out(contacts: _Contacts, count: int, around: Neighbourhood) -> Agreement:
    """How the views of even and of odd number agree on the offsets, each trimmed by itself."""
    sides = []
    for group in (contacts.group, ~contacts.group):
        means, weight = _trimmed_means(contacts, contacts.weights * group[:, None], count)
        sides.append(np.where(weight > _LEAST_WEIGHT, means, np.nan))
    return agreement(sides[0], sides[1], around)
