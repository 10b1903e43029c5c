"""Photo-consistency from end to end: photos and a start surface to a finished surface."""

from collections.abc import Callable, Sequence

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.process.threads import on_all_cores
from methods.stereo.narrow import narrowed
from methods.stereo.patchmatch import DepthMap, StartSurface, depth_map
from methods.stereo.pull import Pulled, StereoPoints, consistent_points
from methods.stereo.settings import StereoSettings
from methods.stereo.views import StereoView, contrast, reduction

#: Seen from the subject. Nearer views hardly tell depth; further ones show other surfaces.
_LEAST_DEG, _MOST_DEG = 10.0, 65.0
#: With eight even views, the next ones, 45 degrees away, are the ones to match.
_BEST_DEG = 35.0


def neighbours(cameras: Sequence[Camera], centre: Floats) -> list[tuple[int, ...]]:
    """For each view the views it is matched with: the best one, and the best on its other side.

    Args:
        cameras: Cameras of all views.
        centre: (3,) of the subject, world metres.

    Returns:
        No, one or two indices for each view; none where all others are too near or too far round.
    """
    eyes = np.concatenate([camera.eye_of(centre[None]) for camera in cameras]) - centre
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True)
    return [_beside(eyes, view) for view in range(len(cameras))]


def _beside(eyes: Floats, view: int) -> tuple[int, ...]:
    angle = np.degrees(np.arccos(np.clip(eyes @ eyes[view], -1.0, 1.0)))
    usable = np.flatnonzero((angle >= _LEAST_DEG) & (angle <= _MOST_DEG))
    if len(usable) == 0:
        return ()
    # Rounded, so that views at equal angles keep the order of their numbers.
    order = usable[np.argsort(np.round(np.abs(angle[usable] - _BEST_DEG), 6), kind="stable")]
    across = eyes[order] - (eyes[order] @ eyes[view])[:, None] * eyes[view]
    opposite = np.flatnonzero(across @ across[0] < 0)
    return (int(order[0]), *(int(order[other]) for other in opposite[:1]))


def pairs(found: Sequence[tuple[int, ...]]) -> list[tuple[int, int]]:
    """Every pair of matched views once, the lower number first, sorted."""
    return sorted({(min(a, b), max(a, b)) for a, others in enumerate(found) for b in others})


#: On photos as coarse as those of the depth maps the narrow search has patches of 4 cm, and makes
#: the surface worse: 5.29 after it and 5.27 mm before on t00021 at ``quick8``, 12.6 and 12.2 deg.
_FINER = 0.75


def stereo_points(
    views: Sequence[StereoView],
    start: Mesh,
    settings: StereoSettings,
    within: Callable[[Floats], Mask] | None = None,
) -> StereoPoints:
    """The points that neighbouring photos agree on around a start surface, world metres.

    Args:
        views: Two or more; views without a neighbour at 10 to 65 degrees give none.
        start: Closed, facing outwards, within 5 cm outside of the subject.
        settings: How.
        within: Which places (N, 3) of the start are searched; all of them unless given.
    """
    centre = start.bounds.mean(axis=0)
    match = settings.match
    photos = [
        contrast(view, reduction(view.camera, centre, match.pixel_m), match.flatten_px)
        for view in views
    ]
    beside = neighbours([photo.camera for photo in photos], centre)
    surface = StartSurface(start, within)

    def found(view: int) -> DepthMap | None:
        return depth_map(view, photos, beside[view], surface, match)

    matched = [view for view, others in enumerate(beside) if others]
    maps = dict(zip(matched, on_all_cores(found, matched), strict=True))
    held = {view: each for view, each in maps.items() if each is not None}
    return consistent_points(held, settings.keep, pixel_span_m([p.camera for p in photos], centre))


def finished(mesh: Mesh, views: Sequence[StereoView], settings: StereoSettings) -> Pulled:
    """The mesh after one narrow search in full resolution, and what it did.

    Without photos finer than those that the depth maps were made of there is nothing new to find:
    the mesh stays, and there is no round.
    """
    centre = mesh.bounds.mean(axis=0)
    narrow = settings.narrow
    span_m = {
        target: pixel_span_m([_reduced(view.camera, centre, target) for view in views], centre)
        for target in (narrow.sample_m, settings.match.pixel_m)
    }
    if span_m[narrow.sample_m] > _FINER * span_m[settings.match.pixel_m]:
        return Pulled(mesh, ())
    photos = [
        contrast(view, reduction(view.camera, centre, narrow.sample_m), narrow.flatten_px)
        for view in views
    ]
    beside = neighbours([photo.camera for photo in photos], centre)
    finest_m = span_m[narrow.sample_m]
    moved, report = narrowed(mesh, photos, pairs(beside), narrow, finest_m)
    return Pulled(moved, (report,))


def _reduced(camera: Camera, centre: Floats, pixel_m: float) -> Camera:
    down = reduction(camera, centre, pixel_m)
    return camera.resized(max(1, camera.width // down), max(1, camera.height // down))


def pixel_span_m(cameras: Sequence[Camera], centre: Floats) -> float:
    """What a pixel spans of a subject at ``centre`` (3,), the median over the cameras, metres."""
    spans = []
    for camera in cameras:
        _, depth = camera.project(centre[None])
        spans.append(float(camera.spread(depth[0])) / camera.K[0, 0])
    return float(np.median(spans))
