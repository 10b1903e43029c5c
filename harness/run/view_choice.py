"""Which photos a method is given that was made for a ring of eight.

Such a method counts views from the front, 45 degrees apart. Imported photos stand anywhere, and a
ring of more photos has others between: each of the method's views gets the photo that was taken
most nearly from there, all together, and each photo once. Views beyond the eighth are those of the
ring itself. And what a method is given beyond these photos, where that follows from them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.errors import MethodError
from harness.core.protocols import RING, MethodInfo, Privilege
from harness.geometry.place import no_depth_is_told
from harness.run.sources import IMPORTED
from harness.run.uncalibrated import ESTIMATE

#: A photo further than this from the place of its view is told.
_FAR_DEG = 30.0
#: Whoever has one of these needs no place of the subject.
_PLACED = (Privilege.GROUND_TRUTH_MESH, Privilege.OWN_FRAME)
_MORE = {True: "Import more photos", False: "Name a --recipe with more"}


@dataclass(frozen=True, slots=True, eq=False)
class ChosenViews:
    """The photos that a method is given.

    Attributes:
        capture: With these photos where the method looks for them.
        details: What a record says of the choice; empty where nothing was chosen.
    """

    capture: Capture
    details: dict[str, object]


def views_for(method: MethodInfo, capture: Capture) -> ChosenViews:
    """The photos of a capture as a method counts them.

    Up to eight rendered photos are counted from the front, and so are those of a method that takes
    all, or that counts further than eight. Of fewer than eight, views that do not exist under their
    numbers are found by where they stand, if there are photos enough; so are all where photos were
    left out because no camera was found for them.

    Raises:
        MethodError: the method takes more photos than there are, or none of parallel rays.
    """
    if method.needs_perspective and any(camera.is_orthographic for camera in capture.cameras):
        raise MethodError(
            f"method '{method.name}' takes no orthographic photos: {method.needs_perspective}",
            got=f"those of '{capture.subject}' by recipe {capture.recipe}",
            hint="Name a --recipe with perspective cameras",
        )
    wanted, count, left_out = method.views, len(capture.cameras), _left_out(capture)
    is_numbered = capture.recipe != IMPORTED and not left_out
    if wanted is None or (is_numbered and not _is_thinned(wanted, count)):
        return ChosenViews(capture.from_front(), {})
    if len(wanted) > count:
        raise MethodError(
            f"method '{method.name}' takes {len(wanted)} photos",
            got=", ".join((f"{count} of '{capture.subject}'", *left_out)),
            hint=f"{_MORE[capture.recipe == IMPORTED]}, or run a method that takes fewer or any "
            "number: econ takes one, mexecon2 two, mexecon+ three or more",
        )
    angles = _angles_deg(capture, wanted)
    chosen = _assigned(angles)
    far = {
        view: round(float(angles[row, photo]), 1)
        for row, (view, photo) in enumerate(zip(wanted, chosen, strict=True))
        if angles[row, photo] > _FAR_DEG
    }
    # Views that the method does not open hold some photo, so that its own are where it counts them.
    order = [chosen[0]] * (max(wanted) + 1)
    for view, photo in zip(wanted, chosen, strict=True):
        order[view] = photo
    numbers = capture.numbers or tuple(range(count))
    picked = replace(
        capture,
        cameras=tuple(capture.cameras[photo] for photo in order),
        numbers=tuple(numbers[photo] for photo in order),
    )
    details: dict[str, object] = {
        "photos_by_view": dict(zip(map(str, wanted), chosen, strict=True))
    }
    if far:
        details["photos_far_from_their_view_deg"] = {str(view): deg for view, deg in far.items()}
    return ChosenViews(picked, details)


def as_given(method: MethodInfo, capture: Capture) -> MethodInfo:
    """What a method says of itself, with the privileges that it has on these photos.

    Estimated cameras are not known ones. Orthographic photos of parallel cameras are the same at
    any depth, so that a method that sees no others is given the subject's centre.
    """
    estimate: Mapping[str, Any] | None = capture.provenance.get(ESTIMATE)
    given = list(method.privileges)
    if estimate is not None:
        instead = [] if estimate["focal"] == "found" else [Privilege.FOCAL_LENGTH]
        instead += [Privilege.ALIGNED] if "own_to_world" in estimate else []
        given = [*instead, *(each for each in given if each != Privilege.KNOWN_CAMERAS)]
    elif _sees_no_depth(method, capture) and not {*_PLACED} & {*given}:
        given.append(Privilege.SUBJECT_CENTRE)
    return replace(method, privileges=tuple(dict.fromkeys(given)))


def _sees_no_depth(method: MethodInfo, capture: Capture) -> bool:
    """Whether a method sees only parallel orthographic photos of a scan."""
    if capture.recipe == IMPORTED or not any(each.is_orthographic for each in capture.cameras):
        return False
    try:
        cameras = views_for(method, capture).capture.cameras
    except MethodError:
        return False
    seen = [view for view in method.views_of(len(cameras)) if view < len(cameras)]
    return bool(seen) and no_depth_is_told([cameras[view] for view in seen])


def _left_out(capture: Capture) -> list[str]:
    """The photos without a camera among those that cameras were found of, and why."""
    photos = (capture.provenance.get(ESTIMATE) or {}).get("photos", ())
    return [f"without {each['name']}: {each['left_out']}" for each in photos if each["left_out"]]


def _is_thinned(wanted: tuple[int, ...], count: int) -> bool:
    """Whether views of a ring of eight are wanted of a ring that has them elsewhere."""
    if count < RING:
        # Of four photos, the front and the back are there, but not under their numbers.
        return len(wanted) <= count <= max(wanted, default=0)
    return count > RING and max(wanted, default=0) < RING


def _angles_deg(capture: Capture, wanted: tuple[int, ...]) -> Floats:
    """(V, N) angles between where views of a ring stand and where photos do, seen from the person.

    The person stands at the origin.
    """
    yaws = [math.radians(capture.front_yaw_deg + 360.0 * view / RING) for view in wanted]
    places = np.array([[math.sin(yaw), 0.0, math.cos(yaw)] for yaw in yaws])
    photos = np.array([camera.position for camera in capture.cameras])
    photos = photos / np.maximum(np.linalg.norm(photos, axis=1, keepdims=True), 1e-9)
    return np.degrees(np.arccos(np.clip(places @ photos.T, -1.0, 1.0)))


def _assigned(angles_deg: Floats) -> list[int]:
    """The photo of each view; the sum of squared angles is least."""
    from scipy.optimize import linear_sum_assignment

    _, photos = linear_sum_assignment(angles_deg**2)
    return [int(photo) for photo in photos]
