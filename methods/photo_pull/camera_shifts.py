"""Cameras that are a pixel or so off, corrected by what pairs of photos say of a surface.

Calibrations leave errors of half a pixel to two. They bend what photos agree on by millimetres: two
pairs of photos then place one point of the surface differently, and noise in the surface's normals
grows. Nearly all of such an error is a shift of the whole photo, and ``shift_system`` finds it from
the contradictions. After each pass the photos are matched again where the cameras now have them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.core.arrays import Floats, Ints, Singles
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.process.threads import on_all_cores
from harness.geometry.raycast import Raycaster
from methods.stereo.membrane import Neighbourhood
from methods.stereo.narrow import (
    PairOffsets,
    correlation_curves,
    outward,
    pair_offsets,
    seen_by_pairs,
    sure_peaks,
)
from methods.stereo.settings import CameraSettings, NarrowSettings
from methods.stereo.surface import neighbours, pairs, pixel_span_m
from methods.stereo.views import Contrast, StereoView, contrast, reduction

#: Differences of offsets are trusted up to about this, metres, and shifts across up to so many
#: pixels; larger ones are outliers and count less and less.
_TRUSTED_M, _TRUSTED_PX = 0.0015, 0.5
#: Photos are expected to lie this many pixels off. Neighbouring points tell nearly the same: so
#: many count as one.
_EXPECTED_PX, _ALIKE = 2.0, 50.0
#: More points of a pair than this say nothing new about its shift across.
_MOST_POINTS = 500
_ROUNDS = 12
#: A direction with a smaller horizontal part has no tangent across the vertical.
_LEAST_ACROSS_SHIFT_SYSTEM = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Contradictions:
    """Points that two pairs of views tell the offset of.

    Attributes:
        points: (N, 3) world metres.
        normals: (N, 3) unit directions along which they were searched.
        pair: (N, 2) numbers of the two pairs.
        offsets: (N, 2) what each says, metres.
        weights: (N,) how much each point counts.
    """

    points: Floats
    normals: Floats
    pair: Ints
    offsets: Floats
    weights: Floats

    @property
    def differences_m(self) -> Floats:
        """(N,) what the first pair says minus what the second does."""
        return self.offsets[:, 0] - self.offsets[:, 1]


@dataclass(frozen=True, slots=True, eq=False)
class Across:
    """By how much the second photo of a pair lies across the lines of matching.

    Attributes:
        number: Of the pair.
        points: (K, 3) on the surface, world metres.
        normals: (K, 3) unit directions out of it.
        pixels: (K,) along ``across_direction``, pixels.
    """

    number: int
    points: Floats
    normals: Floats
    pixels: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Shifts:
    """The answer.

    Attributes:
        pixels: (C, 2) by how much each photo lies right of and below where its camera has it.
        points: How many points told them.
        before_m, after_m: Median contradiction of two pairs without and with these shifts, metres.
    """

    pixels: Floats
    points: int
    before_m: float
    after_m: float


def solved_shifts(
    cameras: Sequence[Camera],
    pairs: Sequence[tuple[int, int]],
    told: Contradictions,
    across: Sequence[Across],
) -> Shifts:
    """The least shifts that explain what pairs of photos say.

    Args:
        cameras: Of the photos that were matched.
        pairs: The views that are matched with each other.
        told: Points that two pairs see; at least one.
        across: What moving one photo of a pair across says, at most once for each pair.
    """
    count = 2 * len(cameras)
    rows = _offset_rows(cameras, pairs, told)
    wanted = told.differences_m
    sides = [_across_row(cameras, pairs[each.number], each) for each in across]
    row_px = np.array([np.median(each.pixels) for each in across])
    # A row of a pair counts like its points, in units of what is trusted.
    weight_px = np.array([min(len(each.pixels), _MOST_POINTS) for each in across])
    hold = np.eye(count) * _ALIKE / _EXPECTED_PX**2
    shifts = np.zeros(count)
    for _ in range(_ROUNDS):
        off = (wanted - rows @ shifts) / _TRUSTED_M
        weights = told.weights / (1.0 + off**2) / _TRUSTED_M**2
        weighted = rows * weights[:, None]
        matrix, right = weighted.T @ rows + hold, weighted.T @ wanted
        if sides:
            side = np.stack(sides)
            beside = (row_px - side @ shifts) / _TRUSTED_PX
            counted = side * (weight_px / (1.0 + beside**2) / _TRUSTED_PX**2)[:, None]
            matrix, right = matrix + counted.T @ side, right + counted.T @ row_px
        shifts = np.linalg.solve(matrix, right)
    return Shifts(
        shifts.reshape(-1, 2),
        len(told.points),
        float(np.median(np.abs(wanted))),
        float(np.median(np.abs(wanted - rows @ shifts))),
    )


def across_direction(first: Camera, second: Camera, point: Floats) -> Floats:
    """(2,) unit direction in the second photo across the line of the first's ray to a point (3,).

    Down rather than up.
    """
    ray = point - first.eye_of(point[None])[0]
    along = _jacobians(second, point[None])[0] @ ray
    across = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-12)
    return across if across[1] >= 0 else -across


def _offset_rows(
    cameras: Sequence[Camera], pairs: Sequence[tuple[int, int]], told: Contradictions
) -> Floats:
    """(N, 2 C) change of the two pairs' difference, metres, per pixel of each shift."""
    tangents = _tangents(told.normals)
    rows = np.zeros((len(told.points), 2 * len(cameras)))
    for number, (first, second) in enumerate(pairs):
        for place, sign in ((0, 1.0), (1, -1.0)):
            at = np.flatnonzero(told.pair[:, place] == number)
            if not len(at):
                continue
            ours, theirs = (
                _on_surface(cameras[view], told.points[at], tangents[at])
                for view in (first, second)
            )
            normal = told.normals[at]
            parallax = ours.moved_by(normal) - theirs.moved_by(normal)
            share = parallax / np.maximum((parallax**2).sum(axis=1, keepdims=True), 1e-12)
            for view, to_tangent, turn in (
                (first, ours.to_tangent, sign),
                (second, theirs.to_tangent, -sign),
            ):
                rows[at, 2 * view : 2 * view + 2] += turn * np.einsum(
                    "ni,nij->nj", share, to_tangent
                )
    return rows


def _across_row(cameras: Sequence[Camera], pair: tuple[int, int], told: Across) -> Floats:
    """(2 C,) change of a pair's shift across per pixel of each shift."""
    first, second = pair
    direction = across_direction(cameras[first], cameras[second], told.points.mean(axis=0))
    tangents = _tangents(told.normals)
    ours = _on_surface(cameras[first], told.points, tangents)
    # What a shift in the first photo looks like in the second.
    carried = (_jacobians(cameras[second], told.points) @ tangents) @ ours.to_tangent
    row = np.zeros(2 * len(cameras))
    row[2 * second : 2 * second + 2] = direction
    row[2 * first : 2 * first + 2] = -direction @ np.median(carried, axis=0)
    return row


@dataclass(frozen=True, slots=True, eq=False)
class _OnSurface:
    """How a camera sees the tangent planes of some points.

    Attributes:
        to_tangent: (N, 2, 2) metres on the plane per pixel.
        jacobians: (N, 2, 3) pixels per world metre.
    """

    to_tangent: Floats
    jacobians: Floats

    def moved_by(self, directions: Floats) -> Floats:
        """(N, 2) metres on the plane by which the picture moves per metre along directions."""
        pixels = np.einsum("nij,nj->ni", self.jacobians, directions)
        return np.einsum("nij,nj->ni", self.to_tangent, pixels)


def _on_surface(camera: Camera, points: Floats, tangents: Floats) -> _OnSurface:
    jacobians = _jacobians(camera, points)
    (a, b), (c, d) = (jacobians @ tangents).transpose(1, 2, 0)
    # In closed form: numpy inverts small matrices one by one.
    inverse = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return _OnSurface(inverse.transpose(2, 0, 1), jacobians)


def _tangents(normals: Floats) -> Floats:
    """(N, 3, 2) two unit directions across each normal and across each other."""
    first = np.cross(normals, [0.0, 1.0, 0.0])
    steep = np.linalg.norm(first, axis=1) < _LEAST_ACROSS_SHIFT_SYSTEM
    first[steep] = np.cross(normals[steep], [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=2)


def _jacobians(camera: Camera, points: Floats) -> Floats:
    """(N, 2, 3) change of the projections of world points (N, 3), pixels per metre."""
    x, y, depth = (points @ camera.rotation.T + camera.world_to_camera[:3, 3]).T
    in_camera = np.zeros((len(points), 2, 3))
    in_camera[:, 0, 0] = in_camera[:, 1, 1] = 1.0 / camera.spread(depth)
    if not camera.is_orthographic:
        in_camera[:, 0, 2], in_camera[:, 1, 2] = -x / depth**2, -y / depth**2
    focal = np.array([camera.K[0, 0], camera.K[1, 1]])
    return focal[:, None] * in_camera @ camera.rotation


#: Fewer points that two pairs see tell nothing, and fewer of a pair nothing of its shift across.
_LEAST_POINTS, _LEAST_ACROSS = 200, 20
#: By how much the best correlation over shifts across exceeds every other peak.
_MARGIN = 0.02
#: Offsets that are tried again where a photo is moved across: the peak moves a little, metres.
_AGAIN_M = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class CameraShifts:
    """By how much photos lie beside where their cameras have them.

    Attributes:
        pixels: (C, 2) right and down, pixels of each photo; what was found.
        points: How many points two pairs of photos told the offset of; 0 where too few did.
        before_m, after_m: Median contradiction of two pairs in the first pass and after the last,
            metres; NaN where too few points tell.
        is_used: Whether the cameras contradict each other by so much that they are corrected.
    """

    pixels: Floats
    points: int
    before_m: float
    after_m: float
    is_used: bool

    @property
    def used_px(self) -> Floats:
        """(C, 2) by how much each camera is corrected, pixels; nothing where they are not."""
        return self.pixels if self.is_used else np.zeros_like(self.pixels)

    def details(self) -> dict[str, object]:
        """Plain JSON values for a record's reader."""
        if not self.points:
            return {"points": 0, "corrected": False}
        return {
            "points": self.points,
            "corrected": self.is_used,
            "shift_px": np.round(self.pixels, 2).tolist(),
            "contradiction_mm": [round(1e3 * each, 3) for each in (self.before_m, self.after_m)],
        }


def camera_shifts(
    mesh: Mesh, views: Sequence[StereoView], narrow: NarrowSettings, settings: CameraSettings
) -> CameraShifts:
    """By how much the photos of some cameras lie beside where these have them.

    Args:
        mesh: Closed, facing outwards, within about a centimetre of the subject, world metres.
        views: The photos.
        narrow: How patches are matched.
        settings: How far is searched, and which errors are corrected.
    """
    search = replace(narrow, reach_m=settings.reach_m, step_m=settings.step_m)
    centre = mesh.bounds.mean(axis=0)
    photos = [
        contrast(view, reduction(view.camera, centre, narrow.sample_m), narrow.flatten_px)
        for view in views
    ]
    scale = np.array(
        [v.camera.K[0, 0] / p.camera.K[0, 0] for v, p in zip(views, photos, strict=True)]
    )
    asked = _Asked.of(mesh, [photo.camera for photo in photos], search, settings.points)
    found = np.zeros((len(photos), 2))
    passes: list[Shifts] = []
    for number in range(settings.passes):
        across_px = settings.across_later_px if number else settings.across_px
        step = asked.shifts(photos, across_px)
        if step is None:
            break
        passes.append(step)
        found += step.pixels
        photos = [
            replace(photo, camera=photo.camera.shifted(*by))
            for photo, by in zip(photos, step.pixels, strict=True)
        ]
        if _rms(step.pixels) < settings.rest_px:
            break
    pixels = found * scale[:, None]
    if not passes:
        return CameraShifts(pixels, 0, np.nan, np.nan, is_used=False)
    before_m, after_m = passes[0].before_m, passes[-1].after_m
    is_used = _rms(pixels) > settings.least_px and after_m < settings.gain * before_m
    return CameraShifts(pixels, passes[-1].points, before_m, after_m, is_used)


def _rms(pixels: Floats) -> float:
    return float(np.sqrt((pixels**2).sum(axis=1).mean()))


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """Points of a surface that the photos are asked about.

    Attributes:
        points: (N, 3) world metres.
        directions: (N, 3) unit, outwards.
        quality: (N, P) how well each pair sees them.
        pairs: The views that are matched with each other.
        search: How.
        pixel_m: What a pixel of the photos spans.
    """

    points: Floats
    directions: Floats
    quality: Floats
    pairs: Sequence[tuple[int, int]]
    search: NarrowSettings
    pixel_m: float

    @classmethod
    def of(cls, mesh: Mesh, cameras: Sequence[Camera], search: NarrowSettings, most: int) -> _Asked:
        centre = mesh.bounds.mean(axis=0)
        every = max(1, len(mesh.vertices) // most)
        places = mesh.vertices[::every], outward(Neighbourhood(mesh))[::every]
        found = pairs(neighbours(cameras, centre))
        quality = seen_by_pairs(Raycaster(mesh), places, cameras, found, search.facing)
        return cls(*places, quality, found, search, pixel_span_m(cameras, centre))

    def shifts(self, photos: Sequence[Contrast], across_px: int) -> Shifts | None:
        """The shifts that the photos tell; None if too few points do."""
        if len(self.pairs) < 2:
            return None
        said = pair_offsets(
            (self.points, self.directions),
            self.quality,
            photos,
            self.pairs,
            (self.search, self.pixel_m),
        )
        both = np.flatnonzero(np.isfinite(said.offsets).all(axis=1))
        if len(both) < _LEAST_POINTS:
            return None
        told = Contradictions(
            self.points[both],
            self.directions[both],
            said.pair[both],
            said.offsets[both],
            said.correlation[both].min(axis=1),
        )

        def moved(number: int) -> Across | None:
            return self._across(number, photos, said, across_px)

        across = [each for each in on_all_cores(moved, range(len(self.pairs))) if each]
        cameras = [photo.camera for photo in photos]
        return solved_shifts(cameras, self.pairs, told, across)

    def _across(
        self, number: int, photos: Sequence[Contrast], said: PairOffsets, most_px: int
    ) -> Across | None:
        """What the photos of a pair say when the second is moved across; None if too little."""
        rows, place = np.nonzero((said.pair == number) & np.isfinite(said.offsets))
        if len(rows) < _LEAST_ACROSS:
            return None
        directions = self.directions[rows]
        points = self.points[rows] + said.offsets[rows, place][:, None] * directions
        first, second = (photos[view] for view in self.pairs[number])
        direction = across_direction(first.camera, second.camera, points.mean(axis=0))
        steps = np.arange(-most_px, most_px + 1)
        again = replace(self.search, reach_m=_AGAIN_M)
        peaks: list[Singles] = []
        for step in steps:
            moved = replace(second, camera=second.camera.shifted(*(step * direction)))
            curve = correlation_curves(points, directions, (first, moved), again, self.pixel_m)
            peaks.append(curve.max(axis=1))
        # Steps of one pixel, found as offsets are.
        own = replace(again, reach_m=float(most_px), step_m=1.0, apart_m=2.0, margin=_MARGIN)
        pixels, _, sure = sure_peaks(np.stack(peaks, axis=1), own)
        if sure.sum() < _LEAST_ACROSS:
            return None
        return Across(number, points[sure], directions[sure], pixels[sure])
