"""Photos of a still person in, cameras out, or one sentence why not."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.process.threads import StepReport, silent
from harness.geometry.place import place_of
from harness.geometry.similarity import camera_similarity
from methods.body.photos.detection import Detections, detect_in
from methods.cameras.adjustment import Rig, Solved, solved
from methods.cameras.checks import (
    check_matches,
    check_round,
    check_sure,
    misfit,
    missed_m,
    misses_px,
    spreads,
    swayed,
)
from methods.cameras.coherence import DistanceMap, distance_map, outline_of
from methods.cameras.landmarks import by_landmarks, landmark_spans
from methods.cameras.matches import (
    Matches,
    MatchRows,
    MatchSearch,
    contradiction_m,
    find_matches,
    met,
)
from methods.cameras.search import Silhouettes, brought_back, coherent, settled, shaken, upright
from methods.cameras.values import (
    STEPS,
    EstimatedCameras,
    Focal,
    PhotoReport,
    PhotoView,
    StageReport,
)
from methods.closed.lattices import contoured, evened, hull_field, hull_lattice

LEAST_PHOTOS, MOST_PHOTOS, _SURE_PHOTOS = 5, 64, 6
#: Landmarks that are this sure, and so many of them, make a person.
_CONFIDENT, _LEAST_LANDMARKS = 0.3, 6
#: Pixels of the outlines' maps, metres: to begin with and to finish, and rays of a photo then.
_COARSE_M, _FINE_M, _FINE_RAYS = 0.004, 0.002, 200
#: Rays are followed so far before and behind the person's middle, and nobody stands nearer, in
#: heights.
_REACH, _NEAREST = 0.5, 0.3
_HULL_STEP_M = 0.008
#: So far above a hull's lowest point feet are as wide as their soles.
_SOLE_M = 0.03
#: Outlines that miss by more than this, root mean square, contradict each other, metres: wrong
#: minima miss by 4 mm, right ones by 0.2 to 0.8.
_COHERENT_M = 0.002
#: Noisy outlines miss by up to this, metres, and all alike: without the worst photo by no less than
#: this share of what they do with it. Where one photo is wrong, the others are coherent without it.
_NOISY_M, _ALIKE = 0.003, 0.6
_STARTS, _SEED = 2, 0
#: The first search for matches, and later ones with cameras that are nearly right; the second is as
#: wide as the first where outlines miss by more than this, which exact masks do not, metres.
_ROUGH_M = 0.0008
_SEARCHES = MatchSearch(sample_m=0.0022, across_px=4), MatchSearch(sample_m=0.0011, across_px=2)
#: A given focal length is doubted where outlines, trusted to so many metres, cost less by this
#: share within so many rounds with one that differs by more than this.
_OTHER_FOCAL_SD_M, _OTHER_FOCAL_GAIN = 0.001, 0.5
_OTHER_FOCAL_ROUNDS, _OTHER_FOCAL_PERCENT = 8, 1.5
#: Given cameras stay where photos would move by less, or two pairs contradict each other by no less
#: than this share of what they did; asked at about so many places. Outlines correct them first
#: where they miss by more than ``_CALM_M``, trusted to these.
_LEAST_PX, _LEAST_GAIN, _PLACES_ASKED = 0.15, 0.9, 2000
_CALM_M, _REFINED_M = 0.0004, (0.008, 0.0028, 0.001)
#: A later search that takes less than this share of the cost away is the last; so many at most.
_REST_GAIN, _MOST_PASSES = 0.1, STEPS - 2
#: A later search that finds less than this share of the matches before it is not taken: photos are
#: too noisy for its finer pixels. With exact masks it finds 0.87 of them or more.
_KEPT_SHARE = 0.4
#: Beside matches outlines are trusted to so many times what is left in them, metres.
_LEFT_SHARE, _LEAST_LEFT_M = 12.0, 0.0005


def estimate_cameras(
    photos: Sequence[PhotoView],
    *,
    focal: Focal,
    height_m: float,
    landmarks: Detections | None = None,
    report: StepReport = silent,
) -> EstimatedCameras:
    """The cameras of photos that were taken around a person who stands still.

    Args:
        photos: 5 to 64, upright, in any order; a neighbour of each within 65 degrees.
        focal: Their focal lengths.
        height_m: The person's height, with shoes and hair, metres.
        landmarks: Of the photos, in their order; None finds them with MediaPipe.
        report: Called after every step, counted on from the photos.

    Raises:
        MethodError: photos that no cameras can be trusted of; the sentence says what is wrong.
        MissingPart: MediaPipe is needed, and not installed.
    """
    steps = _Steps(len(photos), report)
    group = _group(photos, focal, landmarks)
    steps.done("landmarks", {"photos": float(len(group.photos))}, 0.0)
    group, rig, given = _by_landmarks(group, height_m)
    group, rig, given = _by_outlines(group, rig, given, np.random.default_rng(_SEED))
    warnings = check_round(rig, group.reasons)
    rig, given = _finer(group, rig, given, height_m)
    warnings += _other_focal(rig, given)
    steps.done("outlines", {"missed_mm": 1e3 * given.misses_m(rig)[0]}, 0.0)

    while True:
        found, matches = _by_photos(group.photos, rig, given, height_m, steps)
        left = misfit(found, matches)
        if left is None:
            break
        group, rig, given = _without(group, (found.rig, given), *left)
    warnings += check_matches(found.rig, matches)
    found = replace(found, rig=_in_world(found.rig, given, height_m)[0])
    if len(group.photos) < _SURE_PHOTOS:
        warnings += (f"cameras of {len(group.photos)} photos are weak: take eight",)
    told = _answer(group, (found, given, matches), (steps.stages, warnings))
    weak = check_sure(told.turn_sds_deg, missed_m(found.rig, matches), group.reasons)
    return replace(told, warnings=(*told.warnings, *weak))


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """The photos that are worked with.

    Attributes:
        photos: In an order that does not depend on the one given.
        numbers: Of each among those given.
        told: Their landmarks; None where cameras are given.
        base: Their focal lengths and principal points; poses say nothing.
        left_out: Of all that were given: number and reason.
        names: Of all that were given.
    """

    photos: tuple[PhotoView, ...]
    numbers: tuple[int, ...]
    told: Detections | None
    base: Rig
    left_out: dict[int, str]
    names: tuple[str, ...]

    @property
    def reasons(self) -> list[str]:
        """Name and reason of each photo that was left out."""
        return [f"{self.names[number]}: {why}" for number, why in self.left_out.items()]

    def without(self, view: int, why: str) -> _Group:
        """The group without one of its photos."""
        keep = _others(len(self.photos), view)
        left_out = {**self.left_out, self.numbers[view]: why}
        if len(keep) < LEAST_PHOTOS:
            raise MethodError(
                "too few photos are left to find cameras",
                expected=f"at least {LEAST_PHOTOS} photos of one still person",
                got="; ".join(replace(self, left_out=left_out).reasons),
                hint="Take more photos, all around the person",
            )
        return replace(
            self,
            photos=tuple(self.photos[v] for v in keep),
            numbers=tuple(self.numbers[v] for v in keep),
            told=self.told and self.told.at(keep),
            base=self.base.at(keep),
            left_out=left_out,
        )


class _Steps:
    """What stages did, and how long they took."""

    def __init__(self, photos: int, report: StepReport) -> None:
        self.stages: list[StageReport] = []
        self._photos, self._report, self._since = photos, report, time.perf_counter()

    def done(self, name: str, residuals: dict[str, float], gain: float) -> None:
        """A stage has ended."""
        now = time.perf_counter()
        self.stages.append(StageReport(name, now - self._since, residuals, gain))
        self._since = now
        done = min(len(self.stages), STEPS)
        self._report(self._photos + done, self._photos + STEPS)


def _group(photos: Sequence[PhotoView], focal: Focal, landmarks: Detections | None) -> _Group:
    """The photos that show a person.

    Raises:
        MethodError: too few or too many.
    """
    if not LEAST_PHOTOS <= len(photos) <= MOST_PHOTOS:
        raise MethodError(
            "cameras cannot be found from so many photos",
            expected=f"{LEAST_PHOTOS} to {MOST_PHOTOS}",
            got=str(len(photos)),
            hint="Eight photos, evenly around the person, are a good number",
        )
    order = sorted(
        range(len(photos)), key=lambda n: hashlib.sha256(photos[n].rgba.tobytes()).digest()
    )
    chosen = tuple(photos[n] for n in order)
    told = landmarks.at(order) if landmarks else detect_in([p.rgba for p in chosen])
    focal_px = np.array([focal.px[n] for n in order])
    base = Rig(
        rotations=np.tile(np.eye(3), (len(chosen), 1, 1)),
        shifts=np.zeros((len(chosen), 3)),
        base_focal=np.stack([focal_px, focal_px], axis=1),
        middle=np.array([photo.size for photo in chosen]) / 2.0,
        factor_sd=focal.relative_sd,
    )
    names = tuple(photo.name for photo in photos)
    group = _Group(chosen, tuple(order), told, base, {}, names)
    sure = (told.confidence > _CONFIDENT).sum(axis=1)
    for view in reversed(range(len(chosen))):
        if not (chosen[view].rgba[..., 3] >= 128).any():
            group = group.without(view, "its mask is empty")
        elif sure[view] < _LEAST_LANDMARKS:
            group = group.without(view, "no person was detected")
    return group


def _by_landmarks(group: _Group, height_m: float) -> tuple[_Group, Rig, Silhouettes]:
    """The rig that landmarks tell, and the outlines at the size that it sees them in."""
    while True:
        assert group.told is not None
        rig, told = by_landmarks(group.base, group.told)
        depths = rig.depths(rig.points.mean(axis=0))
        nearest = int(np.argmin(depths))
        if depths[nearest] > _NEAREST * height_m:
            maps = _maps(group, rig, _COARSE_M)
            return group, rig, Silhouettes(maps, told, _REACH * height_m)
        group = group.without(nearest, "its landmarks are not those of a person before a camera")


def _maps(group: _Group, rig: Rig, pixel_m: float) -> tuple[DistanceMap, ...]:
    spans = landmark_spans(rig)
    return tuple(
        distance_map(photo, span, pixel_m) for photo, span in zip(group.photos, spans, strict=True)
    )


def _by_outlines(
    group: _Group, rig: Rig, given: Silhouettes, rng: np.random.Generator
) -> tuple[_Group, Rig, Silhouettes]:
    """Coherent cameras, without photos that do not fit the others.

    Raises:
        MethodError: the outlines contradict each other whatever is left out.
    """
    while True:
        best = _begun(rig, given)
        if best[0] < _COHERENT_M:
            return group, *best[1:]
        # One view in the wrong place, or of something else, spoils the others'.
        _, found, held = best
        worst = _worst(found, held)
        if len(rig) > LEAST_PHOTOS:
            keep = _others(len(rig), worst)
            missed, rest, held = _begun(rig.at(keep), given.at(keep))
            if _is_noise(best[0], missed):
                return group, *best[1:]
            if missed < _COHERENT_M:
                whole, again = brought_back(rig.with_views(keep, rest), given, worst)
                of_all, each = again.misses_m(whole)
                if of_all < _COHERENT_M or _is_noise(of_all, missed):
                    return group, whole, again
                return group.without(worst, _off(each[worst])), rest, held
        for _ in range(_STARTS):
            tried = _begun(shaken(rig, rng), given)
            best = min(best, tried, key=lambda each: each[0])
            if best[0] < _COHERENT_M:
                return group, *best[1:]
        missed, found, held = best
        each = held.misses_m(found)[1]
        if len(group.left_out) >= len(group.names) // 4:
            raise _contradiction(missed, each, [photo.name for photo in group.photos])
        worst = _worst(found, held)
        group, rig, given = _without(group, (found, held), worst, _off(each[worst]))


def _is_noise(missed: float, without_worst: float) -> bool:
    """Whether outlines that miss by so much, metres, with and without one, are noisy ones."""
    return missed < _NOISY_M and without_worst > _ALIKE * missed


def _begun(rig: Rig, given: Silhouettes) -> tuple[float, Rig, Silhouettes]:
    """By how much rays miss, metres, where the outlines lead from these cameras; and there."""
    found, held = coherent(rig, given)
    found = settled(found, held)
    return held.misses_m(found)[0], found, held


def _worst(rig: Rig, given: Silhouettes) -> int:
    """The view without which the others miss least."""
    keeps = [_others(len(rig), view) for view in range(len(rig))]
    return int(np.argmin([given.at(keep).misses_m(rig.at(keep))[0] for keep in keeps]))


def _off(missed_m: float) -> str:
    return f"its outline contradicts the others' by {1e3 * missed_m:.0f} mm"


def _without(
    group: _Group, found: tuple[Rig, Silhouettes], view: int, why: str
) -> tuple[_Group, Rig, Silhouettes]:
    """All but one photo."""
    keep = _others(len(found[0]), view)
    return group.without(view, why), found[0].at(keep), found[1].at(keep)


def _others(count: int, view: int) -> list[int]:
    return [other for other in range(count) if other != view]


def _contradiction(missed: float, each: Floats, names: Sequence[str]) -> MethodError:
    order = np.argsort(-each, kind="stable")[:3]
    return MethodError(
        "the photos' outlines contradict each other",
        expected=f"rays that miss by at most {1e3 * _COHERENT_M:.0f} mm",
        got=f"{1e3 * missed:.1f} mm, most in "
        + ", ".join(f"{names[view]} ({1e3 * each[view]:.0f} mm)" for view in order),
        hint="The person moved, masks are wrong, photos are mirrored or show two people, or the "
        "focal length is wrong",
    )


def _finer(group: _Group, rig: Rig, given: Silhouettes, height_m: float) -> tuple[Rig, Silhouettes]:
    """Coherent cameras in metres, upright, and finer outlines."""
    rig, _ = _in_world(rig, given, height_m, 0.012)
    fine = replace(given, maps=_maps(group, rig, _FINE_M))
    return solved(rig, fine.blocks(rig, 0.001, 0.06, _FINE_RAYS), 8).rig, fine


def _other_focal(rig: Rig, given: Silhouettes) -> tuple[str, ...]:
    """A warning where outlines contradict each other much less with another focal length."""
    if rig.factor_sd:
        return ()
    blocks = given.blocks(rig, _OTHER_FOCAL_SD_M, 0.06)
    freed = solved(replace(rig, factor_sd=0.1), blocks, _OTHER_FOCAL_ROUNDS)
    percent = 100 * (np.exp(freed.rig.log_factor) - 1)
    if abs(percent) < _OTHER_FOCAL_PERCENT or freed.gain < _OTHER_FOCAL_GAIN:
        return ()
    text = f"the outlines fit a focal length that is {percent:+.1f} % off the one given much better"
    return (f"{text}: leave it unknown if it is not sure",)


def _in_world(
    rig: Rig, given: Silhouettes, height_m: float, step_m: float = _HULL_STEP_M
) -> tuple[Rig, Mesh]:
    """The rig in metres, +Y up, the person facing +Z about the origin, and the hull there.

    Without a height the rig stays where it is.
    """
    if not height_m:
        return rig, _hull(rig, given, step_m)[0]
    left = rig.points[[11, 23]].mean(axis=0) - rig.points[[12, 24]].mean(axis=0)
    up = upright(rig)
    front = np.cross(left, up)
    front /= np.linalg.norm(front)
    axes = np.stack([np.cross(up, front), up, front])
    rig = rig.in_frame(axes, rig.points.mean(axis=0))
    mesh, floor = _hull(rig, given, step_m)
    low, high = mesh.bounds
    low[1] = floor
    scale = height_m / float(high[1] - low[1])
    rig = rig.in_frame(np.eye(3), (low + high) / 2).resized(scale)
    return rig, replace(mesh, vertices=(mesh.vertices - (low + high) / 2) * scale)


def _hull(rig: Rig, given: Silhouettes, step_m: float) -> tuple[Mesh, float]:
    """The hull of the outlines, and the height at which it stands on the ground if +Y is up."""
    cameras = rig.cameras([(2, 2)] * len(rig))
    outlines = [each.outline(c) for each, c in zip(given.maps, cameras, strict=True)]
    lattice = hull_lattice(outlines, step_m)
    depth = hull_field(outlines, lattice)
    # Below the soles, which no photo shows, a hull goes on for 5 to 8 mm and tapers: the ground is
    # where half of the section a little higher is reached. Two avatars' are found to 2 mm.
    sections = np.clip(depth / step_m + 0.5, 0.0, 1.0).sum(axis=(0, 2))
    first = int(np.argmax(sections > 0))
    half = sections[first + int(np.ceil(_SOLE_M / step_m))] / 2
    layer = first + int(np.argmax(sections[first:] >= half))
    below = sections[layer - 1]
    part = (half - below) / max(float(sections[layer] - below), 1e-9)
    floor = float(lattice.axis(1)[layer] - (1.0 - part) * step_m)
    return evened(contoured(lattice, depth, "visual hull")), floor


def _by_photos(
    photos: Sequence[PhotoView], rig: Rig, given: Silhouettes, height_m: float, steps: _Steps
) -> tuple[Solved, Matches]:
    """The cameras that matches of photos and outlines tell together."""
    number, wide = 0, 2 if given.misses_m(rig)[0] > _ROUGH_M else 1
    last: tuple[Solved, Matches] | None = None
    while True:
        rig, mesh = _in_world(rig, given, height_m)
        matches = find_matches(mesh, rig, photos, _SEARCHES[number >= wide])
        if last and len(matches) < _KEPT_SHARE * len(last[1]):
            return last
        left_m = max(_LEAST_LEFT_M, _LEFT_SHARE * given.misses_m(rig)[0])
        blocks = [given.rays(rig, left_m, _FINE_RAYS), MatchRows(matches.of(~matches.held_out))]
        found = solved(rig, blocks, 8)
        rig = found.rig
        judged = np.abs(met(rig, matches.of(matches.held_out)).off_px)
        residuals = {
            "matches": float(len(matches)),
            "held_out_px": float(np.median(judged)) if len(judged) else np.nan,
            "contradiction_mm": 1e3 * contradiction_m(rig, matches),
            **dict(zip(("bends", "contradictions"), swayed(rig, matches), strict=True)),
            "missed_mm": 1e3 * given.misses_m(rig)[0],
            "outlines_trusted_mm": 1e3 * left_m,
        }
        number += 1
        steps.done(f"photos {number}", residuals, found.gain)
        if number == _MOST_PASSES or (number > wide and found.gain < _REST_GAIN):
            return found, matches
        last = found, matches


def refine_cameras(
    photos: Sequence[PhotoView],
    cameras: Sequence[Camera],
    *,
    report: StepReport = silent,
) -> EstimatedCameras:
    """Cameras that are a few pixels or degrees off, brought to what outlines and photos say.

    They stay in their world: its place, turn and scale are those of the cameras that were given.
    Cameras that would move photos by less than 0.15 pixels, or after which two pairs of photos
    contradict each other by no less than nine tenths of what they did, stay as they are.

    Args:
        photos: In the cameras' order.
        cameras: With these photos' pixels; metres.
        report: Called after every step, counted on from the photos.

    Raises:
        MethodError: photos and cameras that contradict each other.
    """
    steps = _Steps(len(photos), report)
    if any(camera.is_orthographic for camera in cameras):
        raise MethodError("orthographic cameras cannot be refined", expected="perspective ones")
    place = place_of([outline_of(photo, c) for photo, c in zip(photos, cameras, strict=True)])
    rig = replace(Rig.of(cameras), points=place.centre[None])
    spans = landmark_spans(rig)
    maps = [distance_map(p, span, _FINE_M) for p, span in zip(photos, spans, strict=True)]
    given = Silhouettes(tuple(maps), None, _REACH * 2.0 * place.half_height_m)
    if given.misses_m(rig)[0] > _CALM_M:
        for sd_m in _REFINED_M:
            rig = solved(rig, [given.rays(rig, sd_m, _FINE_RAYS)], 10).rig
    missed, each = given.misses_m(rig)
    if missed > _COHERENT_M:
        raise _contradiction(missed, each, [photo.name for photo in photos])
    steps.done("outlines", {"missed_mm": 1e3 * missed}, 0.0)

    found, matches = _by_photos(photos, rig, given, 0.0, steps)
    warnings = check_matches(found.rig, matches)
    moved = _better(cameras, found.rig, matches, _in_world(found.rig, given, 0.0)[1].vertices)
    if moved is None:
        warnings += ("the cameras stay as they were given: no others fit the photos better",)
    kept = replace(Rig.of(moved or cameras), points=found.rig.points)
    names = tuple(photo.name for photo in photos)
    group = _Group(tuple(photos), tuple(range(len(names))), None, kept, {}, names)
    told = _answer(group, (replace(found, rig=kept), given, matches), (steps.stages, warnings))
    gauge = "place, turn and scale of the world are those of the cameras that were given"
    return replace(told, cameras=tuple(moved or cameras), gauge=gauge)


def _answer(
    group: _Group,
    found: tuple[Solved, Silhouettes, Matches],
    told: tuple[Sequence[StageReport], Sequence[str]],
) -> EstimatedCameras:
    """The cameras in the order in which photos were given, and what is left in each.

    Args:
        group: The photos that have cameras.
        found: The least cost, the outlines, and the matches.
        told: Stages and warnings.
    """
    best, given, matches = found
    rig, (own, factor_sd) = best.rig, spreads(best)
    misses = given.misses_m(rig)[1] / landmark_spans(rig)
    off_px = misses_px(rig, matches)
    cameras = rig.cameras([photo.size for photo in group.photos])
    view_of = {number: view for view, number in enumerate(group.numbers)}
    reports: list[PhotoReport] = []
    for number, name in enumerate(group.names):
        if number not in view_of:
            reports.append(PhotoReport(name, np.nan, 0, np.nan, group.left_out[number]))
            continue
        view = view_of[number]
        count = int((matches.views == view).sum())
        reports.append(PhotoReport(name, float(misses[view]), count, float(off_px[view])))
    views = [view_of.get(number) for number in range(len(group.names))]
    return EstimatedCameras(
        cameras=tuple(None if view is None else cameras[view] for view in views),
        covariances=tuple(None if view is None else own[view] for view in views),
        focal_px=tuple(np.nan if view is None else float(rig.focal[view, 0]) for view in views),
        focal_relative_sd=factor_sd,
        stages=tuple(told[0]),
        photos=tuple(reports),
        contradiction_mm=1e3 * contradiction_m(rig, matches),
        warnings=tuple(told[1]),
    )


def _better(
    given: Sequence[Camera], found: Rig, matches: Matches, places: Floats
) -> list[Camera] | None:
    """The cameras that were found, in the world of those given; None where those do as well."""
    own = found.cameras([camera.size for camera in given])
    move = camera_similarity(own, given).similarity
    moved = [move.camera(camera) for camera in own]
    some = places[:: max(1, len(places) // _PLACES_ASKED)]
    by_px = [
        new.project(some)[0] - old.project(some)[0] for new, old in zip(moved, given, strict=True)
    ]
    moved_px = float(np.sqrt((np.stack(by_px) ** 2).sum(axis=2).mean()))
    before_m, after_m = (contradiction_m(Rig.of(each), matches) for each in (given, moved))
    return moved if moved_px >= _LEAST_PX and after_m < _LEAST_GAIN * before_m else None
