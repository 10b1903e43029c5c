"""Points that neighbouring photos have in common, near a surface, and what they say of cameras.

At places on the hull a patch of the tangent plane is moved along the normal and across the lines
on which two photos are matched; where both photos then look alike by far best, the two pixels show
one point. A match says that the second pixel lies on the first one's epipolar line. Where two pairs
of photos tell of one place, both must put it equally far out along the normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints, Mask, Singles
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.process.threads import on_all_cores
from harness.geometry.raycast import Raycaster
from methods.cameras.adjustment import Rig, Rows, cauchy, crosses, pose_columns, seen, sparse_rows
from methods.cameras.values import PhotoView
from methods.stereo.membrane import Neighbourhood
from methods.stereo.narrow import correlation_curves, outward, seen_by_pairs, vertex
from methods.stereo.settings import NarrowSettings
from methods.stereo.surface import neighbours, pairs, pixel_span_m
from methods.stereo.views import Contrast, contrast, reduction, stereo_view

#: Places on the surface; pairs that are asked of each: so many of all that see it, the best ones,
#: and two at least. Sixteen photos that share the places of eight would each have half as many.
_PLACES, _ASKED, _LEAST_ASKED = 6000, 0.25, 2
#: Fewer matches of a pair tell nothing, nor do fewer points that two pairs see.
LEAST_MATCHES = 15
#: A match is trusted to so many pixels, and a place to so many metres; neighbouring places tell
#: nearly the same, so that ten count as one. The latter is of a pixel at a metre's focal length.
_MATCH_PX, _PLACE_M, _ALIKE = 0.3, 0.0007, 0.1
#: One place in so many is not adjusted to, so that it can judge.
_HELD_OUT = 5


@dataclass(frozen=True, slots=True)
class MatchSearch(NarrowSettings):
    """How matches are searched, along the normals and across them.

    Attributes:
        across_px: To either side across the lines of matching, pixels of the picture matched.
    """

    reach_m: float = 0.03
    step_m: float = 0.0015
    correlation: float = 0.75
    margin: float = 0.12
    apart_m: float = 0.004
    across_px: int = 2


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Pairs of pixels that show one point.

    Attributes:
        views: (M, 2) in which.
        first, second: (M, 2) where, pixels of the whole photos.
        place: (M,) number of the place on the surface.
        normals: (M, 3) of the surface there, unit, world axes.
    """

    views: Ints
    first: Floats
    second: Floats
    place: Ints
    normals: Floats

    def __len__(self) -> int:
        return len(self.views)

    @property
    def held_out(self) -> Mask:
        """(M,) which are kept to judge by."""
        return self.place % _HELD_OUT == 0

    @property
    def twice(self) -> Ints:
        """(D, 2) matches of one place by two pairs."""
        order = np.argsort(self.place, kind="stable")
        same = np.flatnonzero(np.diff(self.place[order]) == 0)
        return np.stack([order[same], order[same + 1]], axis=1)

    def of(self, chosen: Mask) -> Matches:
        """Some of them."""
        return Matches(*(values[chosen] for values in self.arrays))

    @property
    def arrays(self) -> list[Any]:
        """All of it, field by field."""
        return [getattr(self, each.name) for each in fields(self)]

    @classmethod
    def joined(cls, parts: Sequence[Matches]) -> Matches:
        """All of some matches, one after the other."""
        return cls(*map(np.concatenate, zip(*(part.arrays for part in parts), strict=True)))

    def counts(self) -> dict[tuple[int, int], int]:
        """How many each pair of views has."""
        found, numbers = np.unique(self.views, axis=0, return_counts=True)
        return {(int(a), int(b)): int(n) for (a, b), n in zip(found, numbers, strict=True)}


def photo_pairs(rig: Rig, centre: Floats) -> list[tuple[int, int]]:
    """The views that are matched with each other."""
    return pairs(neighbours(rig.cameras([(2, 2)] * len(rig)), centre))


def find_matches(mesh: Mesh, rig: Rig, shown: Sequence[PhotoView], search: MatchSearch) -> Matches:
    """What neighbouring photos have in common near a closed surface.

    Args:
        mesh: Facing outwards, within ``reach_m`` of the subject, world metres.
        rig: Cameras that are nearly right.
        shown: Their photos.
        search: How.
    """
    centre = mesh.bounds.mean(axis=0)
    found = photo_pairs(rig, centre)
    views = [
        stereo_view(camera, photo.rgba)
        for camera, photo in zip(rig.cameras([p.size for p in shown]), shown, strict=True)
    ]
    photos = [
        contrast(view, reduction(view.camera, centre, search.sample_m), search.flatten_px)
        for view in views
    ]
    cameras = [photo.camera for photo in photos]
    every = max(1, len(mesh.vertices) // _PLACES)
    points, normals = mesh.vertices[::every], outward(Neighbourhood(mesh))[::every]
    quality = seen_by_pairs(Raycaster(mesh), (points, normals), cameras, found, search.facing)
    asked = max(_LEAST_ASKED, round(_ASKED * len(found)))
    best = np.argsort(-quality, axis=1, kind="stable")[:, :asked]
    span_m = pixel_span_m(cameras, centre)

    def ask(number: int) -> Matches:
        rows = np.flatnonzero((best == number).any(axis=1) & (quality[:, number] > 0))
        pair = found[number]
        two = photos[pair[0]], photos[pair[1]]
        asked = points[rows], normals[rows]
        sure, rays = _asked(asked, two, (search, span_m))
        pixels = [
            ray * rig.focal[view] + rig.middle[view] for ray, view in zip(rays, pair, strict=True)
        ]
        names = np.tile(np.array(pair), (len(sure), 1))
        return Matches(names, pixels[0], pixels[1], rows[sure], normals[rows[sure]])

    nothing, flat = np.zeros(0, np.int64), np.zeros((0, 2))
    none = Matches(np.zeros((0, 2), np.int64), flat, flat, nothing, np.zeros((0, 3)))
    return Matches.joined([none, *on_all_cores(ask, range(len(found)))])


def _asked(
    places: tuple[Floats, Floats],
    two: tuple[Contrast, Contrast],
    how: tuple[MatchSearch, float],
) -> tuple[Ints, tuple[Floats, Floats]]:
    """Which places (K,) two photos surely match at, and the rays (K, 2) there; none if few."""
    (points, normals), (search, span_m), (first, second) = places, how, two
    none = np.zeros(0, np.int64), (np.zeros((0, 2)), np.zeros((0, 2)))
    if len(points) < LEAST_MATCHES:
        return none
    across = _across(first.camera, second.camera, points.mean(axis=0))
    curves: list[Singles] = []
    for step in np.arange(-search.across_px, search.across_px + 1):
        moved = replace(second, camera=second.camera.shifted(*(step * across)))
        curves.append(correlation_curves(points, normals, (first, moved), search, span_m))
    sure, offset, aside = _sure(np.stack(curves), search)
    if len(sure) < LEAST_MATCHES:
        return none
    found = points[sure] + (offset * search.step_m)[:, None] * normals[sure]
    here, there = (photo.camera.project(found)[0] for photo in two)
    # The second picture shows the point beside where its camera has it.
    there = there + aside[:, None] * across
    rays = [
        (pixels - photo.camera.K[:2, 2]) / photo.camera.K[[0, 1], [0, 1]]
        for pixels, photo in zip((here, there), two, strict=True)
    ]
    return sure, (rays[0], rays[1])


def _across(first: Camera, second: Camera, point: Floats) -> Floats:
    """(2,) unit direction in the second picture across the line of the first's ray to a point."""
    ends = np.stack([point, point + 1e-3 * (point - first.position)])
    (x, y), (far_x, far_y) = second.project(ends)[0]
    way = np.array([-(far_y - y), far_x - x])
    return way / max(float(np.linalg.norm(way)), 1e-12)


def _sure(curves: Singles, search: MatchSearch) -> tuple[Ints, Floats, Floats]:
    """Which places (K,) have one clear peak in (S, N, O) curves, and where it is.

    It lies so many steps of offset (K,) and of across (K,) from the middle.
    """
    sides, count, offsets = curves.shape
    flat = curves.transpose(1, 0, 2).reshape(count, -1)
    side, offset = np.unravel_index(flat.argmax(axis=1), (sides, offsets))
    row = np.arange(count)
    peak = flat.max(axis=1)
    far = np.abs(np.arange(offsets) - offset[:, None]) * search.step_m > search.apart_m
    second = np.where(far, curves.max(axis=0), -1.0).max(axis=1)
    inner = (side > 0) & (side < sides - 1) & (offset > 0) & (offset < offsets - 1)
    sure = np.flatnonzero(inner & (peak > search.correlation) & (peak - second > search.margin))
    at, along = side[sure], offset[sure]
    row = row[sure]
    across, out = (
        [curves[at + k * a, row, along + k * b].astype(np.float64) for k in (-1, 0, 1)]
        for a, b in ((1, 0), (0, 1))
    )
    deeper, beside = vertex(*out), vertex(*across)
    return sure, along - (offsets - 1) / 2 + deeper, at - (sides - 1) / 2 + beside


@dataclass(frozen=True, slots=True, eq=False)
class _Met:
    """Where the rays of matches meet, with derivatives by the unknowns of both cameras.

    Attributes:
        points: (M, 3) where, world metres.
        off_px: (M,) distance of the second pixel from the epipolar line.
        off_by: (M, 13) by the first camera, the second, the focal lengths' factor.
        out_m: (M,) of the point, along the normal.
        out_by: (M, 13).
        out_by_px: (M,) if the second pixel lay a pixel further along the line.
        columns: (M, 13) which unknowns these are.
    """

    points: Floats
    off_px: Floats
    off_by: Floats
    out_m: Floats
    out_by: Floats
    out_by_px: Floats
    columns: Ints


def met(rig: Rig, matches: Matches) -> _Met:
    """Matches as the cameras of a rig have them."""
    one, two = matches.views.T
    ray = np.concatenate(
        [(matches.first - rig.middle[one]) / rig.focal[one], np.ones((len(one), 1))], 1
    )
    to = (matches.second - rig.middle[two]) / rig.focal[two]
    turn = np.einsum("mij,mkj->mik", rig.rotations[two], rig.rotations[one])
    way = np.einsum("mij,mj->mi", turn, ray)
    start = rig.shifts[two] - np.einsum("mij,mj->mi", turn, rig.shifts[one])
    rise, gap = way[:, :2] - to * way[:, 2:], to * start[:, 2:] - start[:, :2]
    depth = np.maximum((rise * gap).sum(axis=1) / np.maximum((rise**2).sum(axis=1), 1e-15), 0.05)
    inside = depth[:, None] * ray
    back = rig.rotations[one].transpose(0, 2, 1)
    point = np.einsum("mij,mj->mi", back, inside - rig.shifts[one])
    shown = seen(rig, two, point)
    ahead = np.einsum("mij,mj->mi", back, ray)
    along = np.einsum("mai,mi->ma", shown.by_point, ahead)
    speed = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    tangent = along / speed[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    # The point at its depth in the first camera: R^T (X_c - t).
    aside = np.concatenate([-ray[:, :2] * depth[:, None], np.zeros((len(one), 1))], axis=1)
    moves = np.concatenate(
        [back @ crosses(inside), -back, np.zeros((len(one), 3, 6)), (back @ aside[..., None])],
        axis=2,
    )
    pixels = shown.by_point @ moves
    pixels[:, :, 6:12] += shown.by_pose
    pixels[:, :, 12] += shown.by_factor
    deeper = -np.einsum("ma,mab->mb", tangent, pixels) / speed[:, None]
    moves = moves + ahead[..., None] * deeper[:, None]
    focal = np.full((len(one), 1), 6 * len(rig))
    return _Met(
        points=point,
        off_px=(normal * (shown.pixels - matches.second)).sum(axis=1),
        off_by=np.einsum("ma,mab->mb", normal, pixels),
        out_m=(matches.normals * point).sum(axis=1),
        out_by=np.einsum("mi,mib->mb", matches.normals, moves),
        out_by_px=(matches.normals * ahead).sum(axis=1) / speed,
        columns=np.concatenate([pose_columns(one), pose_columns(two), focal], axis=1),
    )


@dataclass(frozen=True, slots=True, eq=False)
class MatchRows:
    """Epipolar distances of matches, pixels, and contradictions of two pairs, metres.

    Attributes:
        matches: Those that are adjusted to.
        match_px, place_m: What they are trusted to.
    """

    matches: Matches
    match_px: float = _MATCH_PX
    place_m: float = _PLACE_M

    def rows(self, rig: Rig) -> Rows:
        """Both, each in units of what it is trusted to."""
        from scipy.sparse import vstack

        told, (this, other) = met(rig, self.matches), self.matches.twice.T
        off = told.off_px / self.match_px
        apart = (told.out_m[this] - told.out_m[other]) / self.place_m
        weights = [cauchy(residuals, 1.0, 1.0) for residuals in (off, apart)]
        lines = sparse_rows([(told.columns, told.off_by / self.match_px)], rig.size)
        sides = [
            (told.columns[rows], sign * told.out_by[rows] / self.place_m)
            for rows, sign in ((this, 1.0), (other, -1.0))
        ]
        return Rows(
            np.concatenate([off, apart]),
            vstack([lines, sparse_rows(sides, rig.size)]).tocsr(),
            _ALIKE * np.concatenate([weight for weight, _ in weights]),
            _ALIKE * sum(cost for _, cost in weights),
        )


def contradiction_m(rig: Rig, matches: Matches) -> float:
    """Median by which two pairs place a point differently, metres; NaN where too few tell."""
    told, (this, other) = met(rig, matches), matches.twice.T
    if len(this) < LEAST_MATCHES:
        return np.nan
    return float(np.median(np.abs(told.out_m[this] - told.out_m[other])))
