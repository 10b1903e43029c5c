"""The similarity that takes a camera file's world to ours, found, checked, and put into words."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import DataError, HarnessError
from harness.data.lens import ForeignCameras
from harness.data.scans import PLAUSIBLE_HEIGHT_M
from harness.geometry.place import MEAN_HEIGHT_M
from harness.geometry.similarity import Similarity
from harness.photos.agreement import Agreement, hull_agreement, odd_views, other_reading
from harness.photos.load_photos import TakenView
from harness.photos.request import AUTO, ORIGINS, POSSIBLE_HEIGHT_M, ImportRequest, check_height
from harness.photos.world import parsed_axis, stance_of, up_of_cameras, upright

#: Exact masks and cameras of generated people agree to 0.994 and more, mirrored photos of them to
#: 0.85 to 0.91. Below the first, other readings of the cameras are tried; below the second, masks
#: and cameras are told to agree badly; below the third they are refused.
_CERTAIN_IOU, _DOUBTFUL_IOU, _LEAST_IOU = 0.97, 0.95, 0.90
_CHECK = (
    "Check that masks show one whole person, that photos were not cropped, mirrored or exchanged "
    "after calibration, and that the person held still"
)
#: Views that agree less than this on where the person faces are told.
_FACING_AGREEMENT = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A camera file's world in ours.

    Attributes:
        world: The similarity.
        front_yaw_deg: Where the person faces in our world; not 0 only for captures of our own.
        height_m: How high the silhouettes' hull is, metres.
        iou: Of each photo's mask and the hull's.
        notes: How each part was found, one sentence each.
        warnings: What a reader of results should know.
    """

    world: Similarity
    front_yaw_deg: float
    height_m: float
    iou: tuple[float, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, as the capture's provenance has them."""
        return {
            "file_to_world": self.world.matrix.tolist(),
            "hull_height_m": self.height_m,
            "hull_iou": list(self.iou),
            "notes": list(self.notes),
        }


def check_scale(request: ImportRequest, foreign: ForeignCameras) -> float:
    """Metres per unit of the file, where that is given; 0 where height or a prior tells.

    Raises:
        HarnessError: nothing tells it, two things do, a number that is no scale, or an origin that
            is not known.
    """
    if request.origin not in ORIGINS:
        raise HarnessError(f"--origin {request.origin}", expected=" or ".join(ORIGINS))
    if foreign.in_world:
        if request.height_m:
            raise HarnessError(
                f"--height {request.height_m:g} for cameras that are in metres, {foreign.path}",
                hint="Leave --height out, or give --scale with metres per unit",
            )
        return _number(request.scale, default=1.0)
    if bool(request.height_m) == bool(request.scale):
        raise HarnessError(
            f"the length of a unit of the cameras in {foreign.path} has to be told"
            if not request.scale
            else "--height and --scale say the same thing",
            expected="one of --height 1.72 (metres, as the person stands in the photos), --scale 1 "
            "(metres per unit of the file), --scale auto",
            hint="Most programs compute cameras in a unit of their own, and nothing is guessed",
        )
    if request.height_m:
        check_height(request.height_m)
        return 0.0
    return 0.0 if request.scale == AUTO else _number(request.scale, default=1.0)


def _number(text: str, default: float) -> float:
    if text in ("", AUTO):
        return default
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not (np.isfinite(value) and value > 0):
        raise HarnessError(f"--scale {text}", expected="a positive number, or auto")
    return value


def found_up(request: ImportRequest, foreign: ForeignCameras) -> tuple[Floats, str]:
    """(3,) up in the file's world, and how it was found.

    Raises:
        HarnessError: ``--up`` is no direction.
    """
    if request.up != AUTO:
        axis = parsed_axis(request.up)
        if axis is None:
            raise HarnessError(f"--up {request.up}", expected="auto, or such as +z, -y, 0,0,1")
        return axis, f"up is {request.up} of the file, as given"
    if foreign.in_world:
        return np.array([0.0, 1.0, 0.0]), "the world is the capture's own"
    up = up_of_cameras([view.camera for view in foreign.views])
    return up, f"up is {_axis_text(up)} of the file, because the cameras are held level about it"


def placed(
    request: ImportRequest,
    foreign: ForeignCameras,
    up: Floats,
    views: Sequence[TakenView],
    folder: Path,
) -> Placed:
    """Our world in place of the file's.

    Args:
        request: What the user said of it.
        foreign: The camera file.
        up: (3,) in the file's world.
        views: The photos that are used; their pictures lie below ``folder``.
        folder: Of the capture to be.

    Raises:
        HarnessError: what was not said cannot be found, or photos contradict cameras.
        MissingPart: MediaPipe is needed, and not installed.
    """
    standing = upright(up, np.array([0.0, 0.0, 1.0]) if foreign.in_world else None)
    cameras = [standing.camera(view.camera) for view in views]
    agreement = hull_agreement(cameras, [view.coverage for view in views])
    warnings = _contradictions(request, cameras, views, agreement)
    scale, scale_note = _scale(request, foreign, agreement)
    forward, facing_note = _front(request, foreign, up, views, folder)
    turned = upright(up, forward)
    assert agreement.bounds is not None
    height_m = scale * float(agreement.bounds[1, 1] - agreement.bounds[0, 1])
    low, high = PLAUSIBLE_HEIGHT_M
    if not low <= height_m <= high:
        warnings.append(
            f"the person is {height_m:.2f} m high, outside {low} to {high} m: check --scale"
        )
    middle = agreement.bounds.mean(axis=0) @ standing.rotation  # back in the file's axes
    keeps = foreign.in_world or request.origin == "file"
    shift = np.zeros(3) if keeps else -scale * (turned.rotation @ middle)
    return Placed(
        world=Similarity(scale, turned.rotation, shift),
        front_yaw_deg=foreign.front_yaw_deg if foreign.in_world else 0.0,
        height_m=height_m,
        iou=agreement.iou,
        notes=(facing_note, scale_note),
        warnings=tuple(warnings),
    )


def _contradictions(
    request: ImportRequest,
    cameras: Sequence[Camera],
    views: Sequence[TakenView],
    agreement: Agreement,
) -> list[str]:
    """Doubts about photos and cameras; refused where they do not belong together."""
    if min(agreement.iou) >= _CERTAIN_IOU:
        return []
    masks, names = [view.coverage for view in views], [view.photo.name for view in views]
    is_sure = agreement.mean >= _CERTAIN_IOU
    other = None if is_sure else other_reading([v.camera for v in views], masks, agreement.mean)
    odd = {} if other or agreement.bounds is None else odd_views(cameras, masks)
    hint = f"They would agree ({other.iou:.3f}) if {other.name}" if other else _CHECK
    what, least = "photos and cameras contradict each other: ", agreement.mean
    if agreement.bounds is None:
        raise DataError(what + agreement.reason, hint=hint)
    if odd and min(odd.values()) < _DOUBTFUL_IOU:
        least = min(odd.values())
        what += "all other silhouettes agree without those of " + ", ".join(
            f"{names[view]}, which their hull covers with an IoU of {iou:.3f}"
            for view, iou in odd.items()
        )
    elif other or agreement.mean < _DOUBTFUL_IOU:
        worst = int(np.argmin(agreement.iou))
        what += (
            f"the hull of all silhouettes covers them with an IoU of {agreement.mean:.3f} in the "
            f"mean, {agreement.iou[worst]:.3f} in {names[worst]}"
        )
    else:
        return []
    refused = other is not None or least < _LEAST_IOU
    if refused and not request.accept:
        raise DataError(what, hint=f"{hint}. --accept imports them all the same")
    return [f"{what}. {hint}"]


def _scale(
    request: ImportRequest, foreign: ForeignCameras, agreement: Agreement
) -> tuple[float, str]:
    """Metres per unit of the file, and how that is known."""
    given = check_scale(request, foreign)
    assert agreement.bounds is not None
    height = float(agreement.bounds[1, 1] - agreement.bounds[0, 1])
    if given:
        low, high = POSSIBLE_HEIGHT_M
        if not low <= given * height <= high:
            raise DataError(
                f"the person would be {given * height:.4g} m high",
                expected=f"{low} to {high} m",
                hint=f"The silhouettes span {height:.4g} units of the file: give --height in "
                "metres, or another --scale",
            )
        return given, f"1 unit of the file is {given:g} m, as given"
    if request.height_m:
        scale = request.height_m / height
        return scale, (
            f"1 unit of the file is {scale:.4g} m, because the person is {request.height_m:g} m "
            "high in the photos, as given"
        )
    scale = MEAN_HEIGHT_M / height
    return scale, (
        f"1 unit of the file is taken for {scale:.4g} m: an estimate, from the prior that the "
        f"silhouettes' hull is {MEAN_HEIGHT_M:g} m high"
    )


def _front(
    request: ImportRequest,
    foreign: ForeignCameras,
    up: Floats,
    views: Sequence[TakenView],
    folder: Path,
) -> tuple[Floats, str]:
    """(3,) where the person faces in the file's world, and how that is known."""
    if foreign.in_world and request.facing == AUTO:
        return np.array([0.0, 0.0, 1.0]), "the front is the capture's own"
    if request.facing != AUTO:
        return _named_front(request.facing, views)
    capture = Capture("", "", "", "", folder, tuple(view.camera for view in views))
    stance = stance_of(capture, up)
    if stance is None:
        raise DataError(
            "no photo shows which way the person faces",
            expected="landmarks of a person in at least one photo",
            hint="Give --facing: a direction of the file such as -y, or the name of a photo that "
            "was taken from the front",
        )
    if not stance.upright:
        raise DataError(
            f"the person stands head down if up is {_axis_text(up)} of the file",
            hint=f"Give --up {_axis_text(-up)}, or turn the photos if they are upside-down",
        )
    note = (
        f"the person faces {_axis_text(stance.forward)} of the file, as landmarks in "
        f"{stance.found} of {stance.asked} photos tell"
    )
    if stance.agreement < _FACING_AGREEMENT:
        note += f"; the photos agree badly on it ({stance.agreement:.2f}), so check the first view"
    return stance.forward, note


def _named_front(text: str, views: Sequence[TakenView]) -> tuple[Floats, str]:
    axis = parsed_axis(text)
    if axis is not None:
        return axis, f"the person faces {text} of the file, as given"
    for view in views:
        if text in (view.photo.name, view.photo.path.stem):
            return -view.camera.forward, f"the person faces the camera of {text}, as given"
    raise HarnessError(
        f"--facing {text}",
        expected="auto, a direction such as -y or 0,0,1, or the name of a photo that is used",
    )


def _axis_text(axis: Floats) -> str:
    rounded = np.round(axis, 3) + 0.0  # no minus before a zero
    return ",".join(f"{value:g}" for value in rounded)
