"""PIXIE's body of each view, in the frame that the known cameras make common.

PIXIE sees a square crop around the subject and believes in a camera whose rays are parallel. Here
that camera looks along the ray through the middle of the crop: its axes are those of the calibrated
camera turned onto that ray, and its scale tells the distance.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.protocols import Part
from harness.geometry.images import resampled
from harness.geometry.photo import open_photo
from harness.geometry.window import Window
from methods.body.models.smplx_body import SmplxBody
from methods.body.photos.views import View
from methods.parts.converted import NETWORK, OUTPUTS, PIXIE
from methods.parts.onnx_networks import answers, open_session

if TYPE_CHECKING:
    from torch import Tensor


_SHAPE, _EXPRESSION = 200, 50
_BODY_JOINTS, _FINGER_JOINTS = 17, 15
#: SMPL-X joints whose turns are absolute, and the joints between them and the root, nearest first.
_ABSOLUTE = {
    15: (12, 9, 6, 3, 0),
    20: (18, 16, 13, 9, 6, 3, 0),
    21: (19, 17, 14, 9, 6, 3, 0),
}
_HEAD = 15
#: A head that turns further about one of its axes is not turned about it at all.
_MOST_HEAD_DEG = (20.0, 70.0, 10.0)
#: Changes the frame of a left hand that was regressed as a right one.
_MIRRORED = np.array([[1.0, -1.0, -1.0], [-1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class PixieView:
    """The body of one picture.

    Rotations are matrices. The frame is the picture's: x right, y down, z away from the viewer.

    Attributes:
        camera: (3,) scale s, and x and y of a translation t; a point p of the body is seen at
            s (p + t), from -1 to 1 over the picture.
        orientation: (3, 3) of the whole body.
        body_pose: (21, 3, 3) of the joints 1 to 21 against their parents.
        jaw, left_hand, right_hand: (3, 3), (15, 3, 3) and (15, 3, 3) against their parents.
        shape: (200,) in the space of SMPLX_NEUTRAL_2020.
        expression: (50,) likewise.
    """

    camera: Floats
    orientation: Floats
    body_pose: Floats
    jaw: Floats
    left_hand: Floats
    right_hand: Floats
    shape: Floats
    expression: Floats


def decoded(numbers: dict[str, NDArray[np.float32]]) -> PixieView:
    """The body behind the network's answers to one picture.

    Args:
        numbers: (count,) by the names of ``OUTPUTS``.

    Raises:
        MethodError: they are not of these sizes, or not finite.
    """
    for name, count in OUTPUTS.items():
        if numbers[name].shape != (count,) or not np.isfinite(numbers[name]).all():
            raise MethodError(
                f"PIXIE's answer '{name}' cannot be used",
                expected=f"{count} finite numbers",
                got=f"shape {numbers[name].shape}",
            )
    values = {name: array.astype(np.float64) for name, array in numbers.items()}
    camera, turned = values["body"][:3], six_to_matrices(values["body"][3:])
    orientation, part, neck = turned[0], turned[1 : 1 + _BODY_JOINTS], turned[-1]
    head = values["head"]
    shape, expression = head[:_SHAPE], head[_SHAPE : _SHAPE + _EXPRESSION]
    head_turn = six_to_matrices(head[-9:-3])[0]
    hands = {side: six_to_matrices(values[f"{side}_hand"]) for side in ("left", "right")}
    hands["left"] = hands["left"] * _MIRRORED
    wrists = [hands[side][0] for side in ("left", "right")]
    pose = np.stack([*part[:11], neck, *part[11:13], head_turn, *part[13:], *wrists])
    return PixieView(
        camera=camera,
        orientation=orientation,
        body_pose=_relative(orientation, pose),
        jaw=_from_euler(head[-3:]),
        left_hand=hands["left"][1:],
        right_hand=hands["right"][1:],
        shape=shape,
        expression=expression,
    )


def six_to_matrices(numbers: Floats) -> Floats:
    """(N, 3, 3) rotations from (6 N,) numbers: two columns, row by row, made perpendicular."""
    first, second = np.moveaxis(numbers.reshape(-1, 3, 2), 2, 0)
    x = first / np.linalg.norm(first, axis=1, keepdims=True)
    y = second - (x * second).sum(1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=2)


def _relative(orientation: Floats, pose: Floats) -> Floats:
    """Turns (21, 3, 3) of which head and wrists are absolute, all against their parents."""
    found = pose.copy()
    for joint, above in _ABSOLUTE.items():
        parent = np.eye(3)
        for index in reversed(above):
            parent = parent @ (orientation if index == 0 else found[index - 1])
        found[joint - 1] = parent.T @ pose[joint - 1]
        if joint == _HEAD:
            found[joint - 1] = _plausible_head(found[joint - 1])
    return found


def _plausible_head(turn: Floats) -> Floats:
    from scipy.spatial.transform import Rotation

    angles = Rotation.from_matrix(turn).as_euler("XYZ", degrees=True)
    plausible = np.abs(angles) <= _MOST_HEAD_DEG
    return _from_euler(np.radians(np.where(plausible, angles, 0.0)))


def _from_euler(angles: Floats) -> Floats:
    """(3, 3) turn about x, then the turned y, then the turned z; radians."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("XYZ", angles).as_matrix()


#: As ECON crops: the subject's box fills this share of a square of so many pixels over black, which
#: is then made smaller.
_FILLED, _CROP_PX, _NETWORK_PX = 0.9, 512, 224


def pixie_part() -> Part:
    """The imported network, as records name it.

    Raises:
        MissingPart: it is not imported, or its file is gone.
        DataError: the file is another one.
    """
    return PIXIE.find().installed.part(PIXIE.about.role)


def pixie_sees(views: tuple[View, ...], capture: Capture) -> tuple[PixieView, ...]:
    """The body that PIXIE regresses from each view's photo, in the frame of its picture.

    Raises:
        MethodError: PIXIE answers with what is no body.
        MissingPart, DataError: as ``pixie_part``.
    """
    stored = PIXIE.find()
    session = _session(stored.file(NETWORK), stored.installed.sha256)
    return tuple(_regressed(session, capture, view) for view in views)


def held_values(body: SmplxBody, seen: PixieView) -> dict[str, Floats]:
    """What a fit keeps of one view's PIXIE: fingers and jaw, and the expression where it counts.

    Args:
        body: The model; expressions count where it is the one that PIXIE was made with.
        seen: Of the view in which face and hands are looked at: the first in MExECON.
    """
    from scipy.spatial.transform import Rotation

    def vectors(turns: Floats) -> Floats:
        return Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec().ravel()

    held = {
        "jaw_pose": vectors(seen.jaw),
        "left_hand_pose": vectors(seen.left_hand),
        "right_hand_pose": vectors(seen.right_hand),
    }
    return {**held, "expression": seen.expression} if body.has_pixie_shape else held


def pixie_each_view(
    body: SmplxBody, views: tuple[View, ...], seen: tuple[PixieView, ...], capture: Capture
) -> dict[str, Tensor]:
    """Parameters of N bodies, each regressed from one view's photo.

    Args:
        body: Whose parameters they are. Shape values count where the model is the one that PIXIE
            was made with; otherwise the shape is the mean.
        views: N views.
        seen: What PIXIE sees in each.
        capture: The photos, with cameras in the same frame as the views'.

    Raises:
        MethodError: PIXIE answers with a body of no size.
    """
    import torch

    pairs = zip(views, seen, strict=True)
    found = [_start(body, view, own, capture) for view, own in pairs]
    return {
        name: torch.tensor(np.stack([getattr(one, name) for one in found]), dtype=torch.float32)
        for name in ("orientation", "translation", "pose", "shape")
    }


def crop_window(capture: Capture, view: int) -> Window:
    """The square of a photo that PIXIE sees."""
    return Window.around(open_photo(capture, view).mask).square(_FILLED)


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """One body's parameters."""

    orientation: Floats
    translation: Floats
    pose: Floats
    shape: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """How PIXIE's parallel camera stands.

    Attributes:
        turn: (3, 3) from its axes to the world's.
        distance_m: From the calibrated camera's centre along its axis to where PIXIE's body is.
    """

    turn: Floats
    distance_m: float


def seen_by(camera: Camera, scale: float) -> Seen:
    """PIXIE's camera of a square crop.

    Args:
        camera: The crop's.
        scale: PIXIE's: a metre covers this share of half the crop.

    Raises:
        MethodError: a scale that is not above 0.
    """
    if not scale > 0:
        raise MethodError(
            "PIXIE sees a body of no size", expected="a scale above 0", got=f"{scale:g}"
        )
    middle = np.array([[camera.width / 2, camera.height / 2]])
    ray = camera.rotation @ camera.ray_directions(middle)[0]
    length = float(np.linalg.norm(ray))
    # Beside the middle of the picture, a pixel covers a smaller angle.
    focal_px = camera.K[0, 0] * length
    distance_m = 2.0 * focal_px / (scale * camera.width)
    return Seen(camera.rotation.T @ _onto(ray / length), distance_m)


def _start(body: SmplxBody, view: View, seen: PixieView, capture: Capture) -> _Start:
    from scipy.spatial.transform import Rotation

    camera = crop_window(capture, view.index).camera(capture.cameras[view.index])
    eye = camera.ray_origins([[camera.width / 2, camera.height / 2]])[0]
    parallel = seen_by(camera, float(seen.camera[0]))
    shape = np.zeros(body.shape_prior.shape[1])
    if body.has_pixie_shape:
        shape = seen.shape[: len(shape)]
    root = body.rest_root(shape)
    aside, distance_m = root[:2] + seen.camera[1:], parallel.distance_m
    if view.place.depth_is_known or camera.is_orthographic:
        # The same direction, at the distance that the other views tell.
        held_m = float(parallel.turn[:, 2] @ (view.place.centre - eye))
        aside, distance_m = aside * float(camera.spread(held_m)) / distance_m, held_m
    place = parallel.turn @ np.array([*aside, distance_m + root[2]])
    return _Start(
        orientation=(parallel.turn @ seen.orientation)[:, :2],
        translation=eye + place,
        pose=Rotation.from_matrix(seen.body_pose).as_rotvec(),
        shape=shape,
    )


def _onto(ray: Floats) -> Floats:
    """(3, 3) the least rotation that turns the optical axis onto a unit ray, in camera axes."""
    from scipy.spatial.transform import Rotation

    axis = np.cross([0.0, 0.0, 1.0], ray)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3)
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, ray[2])).as_matrix()


def _regressed(session: Any, capture: Capture, view: View) -> PixieView:
    photo = open_photo(capture, view.index).cropped(crop_window(capture, view.index))
    picture = photo.resized(_CROP_PX, _CROP_PX)
    black = picture.rgb * picture.mask[..., None]
    small = resampled(black, (_NETWORK_PX, _NETWORK_PX), "bilinear")
    pixels: NDArray[np.float32] = np.moveaxis(small, -1, 0)[None].astype(np.float32)
    found = answers(session, "PIXIE", {"picture": pixels})
    return decoded({name: each[0] for name, each in zip(OUTPUTS, found, strict=True)})


@functools.lru_cache(maxsize=1)
def _session(path: Path, _sha256: str) -> Any:
    return open_session(path, gpu=True)
