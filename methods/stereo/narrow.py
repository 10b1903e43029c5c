"""The search that finishes: along the surface's normals, in the photos' full resolution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from harness.core.arrays import Floats, Ints, Mask, Singles
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.process.threads import on_all_cores
from harness.geometry.raycast import Raycaster
from methods.stereo.kernels import Pair, Patches, band_search, device_array, launch, quads
from methods.stereo.membrane import Neighbourhood, agreement
from methods.stereo.patchmatch import window_weights
from methods.stereo.pull import RoundReport, round_report
from methods.stereo.settings import NarrowSettings
from methods.stereo.views import Contrast

_SMOOTHINGS = 4
#: Rays to the cameras start so far above the surface.
_LIFT_M = 0.003
#: Pairs of views that a vertex asks at most: the two that see it best.
_ASKED = 2
#: Weight of an offset that only one pair of views tells.
_ONE_PAIR = 0.4
#: An offset that differs by more from its neighbourhood's is an outlier.
_LONE_M, _LONE_SPREAD, _LONE_LEAST = 0.0035, 6, 0.12
#: Width of the patches' weights, over half the patch.
_SPREAD = 0.6
#: Eight bits cannot show less contrast.
_LEAST_CONTRAST = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class PairOffsets:
    """What the pairs of views say that see each point of a surface best.

    Attributes:
        pair: (V, 2) numbers of the pairs, the better one first; a point that fewer see has numbers
            that say nothing.
        offsets: (V, 2) how far along its direction the photos of a pair match best, metres; NaN
            where a pair says nothing.
        correlation: (V, 2) there.
    """

    pair: Ints
    offsets: Floats
    correlation: Floats


def narrowed(
    mesh: Mesh,
    photos: Sequence[Contrast],
    pairs: Sequence[tuple[int, int]],
    settings: NarrowSettings,
    pixel_m: float,
) -> tuple[Mesh, RoundReport]:
    """The mesh with every vertex at the best correlation nearby, as far as photos agree on it.

    Args:
        mesh: Closed, facing outwards, within a few millimetres of the subject.
        photos: Photos of all views, in full resolution.
        pairs: The views that are matched with each other.
        settings: How.
        pixel_m: What a pixel of the photos spans of the subject.
    """
    around = Neighbourhood(mesh)
    directions = outward(around)
    places = mesh.vertices, directions
    cameras = [photo.camera for photo in photos]
    quality = seen_by_pairs(Raycaster(mesh), places, cameras, pairs, settings.facing)
    asked = pair_offsets(places, quality, photos, pairs, (settings, pixel_m))
    first, second = asked.offsets.T
    believed = agreement(first, second, around)
    contradict = np.abs(first - second) > settings.agree_m
    said = np.isfinite(asked.offsets) & ~contradict[:, None]
    weight = np.where(said, asked.correlation, 0.0)
    total = weight.sum(axis=1)
    offsets = (np.where(said, asked.offsets, 0.0) * weight).sum(axis=1) / np.maximum(total, 1e-9)
    known = (total > 0) * np.where(said.all(axis=1), 1.0, _ONE_PAIR)
    for _ in range(2):
        known = known * _with_neighbours(offsets, known, around)
    motion = around.motion(offsets, known * believed.share, settings.membrane_m)
    moved = replace(mesh, vertices=mesh.vertices + motion[:, None] * directions)
    return moved, round_report(known, believed, motion)


def outward(around: Neighbourhood) -> Floats:
    """(V, 3) unit directions along which a mesh is searched."""
    return around.smooth_normals(_SMOOTHINGS)


def pair_offsets(
    places: tuple[Floats, Floats],
    quality: Floats,
    photos: Sequence[Contrast],
    pairs: Sequence[tuple[int, int]],
    how: tuple[NarrowSettings, float],
) -> PairOffsets:
    """What the two pairs say that see each point best.

    Args:
        places: (V, 3) points, world metres, and (V, 3) unit directions to search along.
        quality: (V, P) of ``seen_by_pairs``.
        photos: Photos of all views.
        pairs: The views that are matched with each other.
        how: The settings, and what a pixel of the photos spans of the subject, metres.
    """
    points, directions = places
    settings, pixel_m = how
    best = np.argsort(-quality, axis=1, kind="stable")[:, :_ASKED]
    offsets, correlation = np.full((len(points), _ASKED), np.nan), np.zeros((len(points), _ASKED))

    def ask(number: int) -> None:
        # Each pair writes into places of its own.
        two = photos[pairs[number][0]], photos[pairs[number][1]]
        for place in range(best.shape[1]):
            rows = np.flatnonzero((best[:, place] == number) & (quality[:, number] > 0))
            if len(rows):
                curve = correlation_curves(points[rows], directions[rows], two, settings, pixel_m)
                found, peak, sure = sure_peaks(curve, settings)
                offsets[rows[sure], place] = found[sure]
                correlation[rows[sure], place] = peak[sure]

    on_all_cores(ask, range(len(pairs)))
    return PairOffsets(best, offsets, correlation)


def seen_by_pairs(
    surface: Raycaster,
    places: tuple[Floats, Floats],
    cameras: Sequence[Camera],
    pairs: Sequence[tuple[int, int]],
    facing: float,
) -> Floats:
    """(V, P) the lesser cosine at which a pair of views sees each point; 0 where one does not.

    Args:
        surface: What may hide a point.
        places: (V, 3) points of it, world metres, and (V, 3) unit directions out of it.
        cameras: Of all views.
        pairs: The views that are matched with each other.
        facing: Least cosine.
    """
    points, directions = places
    seen = np.zeros((len(points), len(cameras)))
    for view, camera in enumerate(cameras):
        toward = camera.eye_of(points) - points
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        cosine = np.einsum("ij,ij->i", toward, directions)
        rows = np.flatnonzero(cosine > facing)
        origins = points[rows] + _LIFT_M * directions[rows]
        free = ~surface.blocked(origins, toward[rows])
        seen[rows[free], view] = cosine[rows[free]]
    both: list[Floats] = [np.minimum(seen[:, a], seen[:, b]) for a, b in pairs]
    return np.stack(both, axis=1) if both else np.zeros((len(points), 0))


def _offsets(settings: NarrowSettings) -> Floats:
    steps = round(settings.reach_m / settings.step_m)
    return settings.step_m * np.arange(-steps, steps + 1)


def correlation_curves(
    points: Floats,
    normals: Floats,
    two: tuple[Contrast, Contrast],
    settings: NarrowSettings,
    pixel_m: float,
) -> Singles:
    """(N, K) correlation of two photos for every point and offset."""
    pair, patches = Pair(), Patches()
    projections = [photo.camera.projection.ravel() for photo in two]
    pair.first, pair.second = (_quads(photo) for photo in two)
    pair.projections = device_array(np.stack(projections), wp.float32)
    pair.floors = device_array([max(p.noise, _LEAST_CONTRAST) ** 2 for p in two], wp.float32)
    offsets = _offsets(settings)
    patches.points, patches.normals = device_array(points, wp.vec3), device_array(normals, wp.vec3)
    patches.offsets = device_array(offsets, wp.float32)
    patches.weights = device_array(window_weights(settings.radius, _SPREAD), wp.float32)
    patches.radius = settings.radius
    patches.sample_m = max(settings.sample_m, pixel_m)
    curve = device_array(np.full((len(points), len(offsets)), -1.0), wp.float32)
    launch(band_search, len(points), [pair, patches, curve])
    return curve.numpy()


def _quads(photo: Contrast) -> Any:
    """A photo as the kernels read it, made once for all that share its values."""
    if "quads" not in photo.made:
        photo.made["quads"] = quads(photo.values[None])
    return photo.made["quads"]


def sure_peaks(curve: Singles, settings: NarrowSettings) -> tuple[Floats, Floats, Mask]:
    """(N,) offset of the best correlation between steps, the correlation, and whether it is sure:
    high, away from the ends, and clear of every other peak.
    """
    offsets = _offsets(settings)
    row = np.arange(len(curve))
    top = curve.argmax(axis=1)
    inner = np.clip(top, 1, len(offsets) - 2)
    before, at, after = (curve[row, inner + k].astype(np.float64) for k in (-1, 0, 1))
    found = offsets[inner] + vertex(before, at, after) * settings.step_m
    peak = curve[row, top].astype(np.float64)
    sure = (inner == top) & (peak > settings.correlation)
    return found, peak, sure & (peak - _second(curve, offsets, top, settings) > settings.margin)


def vertex(before: Floats, at: Floats, after: Floats) -> Floats:
    """(N,) how far a parabola's top is from the middle one of three values, steps: -1 to 1."""
    bend = before - 2.0 * at + after
    curved = bend < -1e-9
    shift = np.where(curved, 0.5 * (before - after) / np.where(curved, bend, -1.0), 0.0)
    return np.clip(shift, -1.0, 1.0)


def _second(curve: Singles, offsets: Floats, top: Ints, settings: NarrowSettings) -> Floats:
    """(N,) the highest other peak, further than ``apart_m`` from the highest; -1 where none."""
    is_peak = np.zeros(curve.shape, dtype=bool)
    is_peak[:, 1:-1] = (curve[:, 1:-1] >= curve[:, :-2]) & (curve[:, 1:-1] >= curve[:, 2:])
    is_peak[:, 0], is_peak[:, -1] = curve[:, 0] > curve[:, 1], curve[:, -1] > curve[:, -2]
    far = np.abs(offsets[None] - offsets[top][:, None]) > settings.apart_m
    return np.where(is_peak & far, curve, -1.0).max(axis=1).astype(np.float64)


def _with_neighbours(offsets: Floats, known: Floats, around: Neighbourhood) -> Mask:
    """(V,) whether an offset is like those beside it."""
    weight = around.averaged(known, _LONE_SPREAD)
    mean = around.averaged(known * offsets, _LONE_SPREAD) / np.maximum(weight, 1e-6)
    return (np.abs(offsets - mean) < _LONE_M) & (weight > _LONE_LEAST)
