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

from harness.core.arrays import Floats, Singles
from harness.core.cameras.camera import Camera
from harness.core.mesh import Mesh
from harness.core.process.threads import on_all_cores
from harness.geometry.raycast import Raycaster
from methods.photo_pull.shift_system import (
    Across,
    Contradictions,
    Shifts,
    across_direction,
    solved_shifts,
)
from methods.stereo.membrane import Neighbourhood
from methods.stereo.narrow import (
    PairOffsets,
    correlation_curves,
    outward,
    pair_offsets,
    seen_by_pairs,
    sure_peaks,
)
from methods.stereo.neighbours import neighbours, pairs
from methods.stereo.settings import CameraSettings, NarrowSettings
from methods.stereo.surface import pixel_span_m
from methods.stereo.views import Contrast, StereoView, contrast, reduction

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
