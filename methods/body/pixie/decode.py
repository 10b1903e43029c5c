"""What PIXIE's numbers mean: rotations of SMPL-X's joints, shape, expression and a camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.errors import MethodError
from methods.body.pixie.part import OUTPUTS

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
