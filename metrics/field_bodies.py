"""Errors of fitted bodies in the field's words: MPJPE, PVE, MPJAE, as given and after Procrustes.

``metrics/body.py`` has errors without any alignment. Here a protocol says which joints count and
what both bodies are moved to first: users could not repeat published numbers for want of these two.

Source: EMDB, ``evaluation_metrics.py`` of its code; SPIN, ``eval.py`` of its code (3DPW).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError
from harness.core.results import MetricValue
from harness.core.units import MM_PER_METRE, Unit

SMPL_JOINTS = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle",
    "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar",
    "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist",
    "right_wrist", "left_hand", "right_hand",
)  # fmt: skip
LSP_JOINTS = (
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist",
    "right_elbow", "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "neck", "head",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class BodyProtocol:
    """Which joints count, and what is brought to the origin.

    Attributes:
        name: As in tables.
        version: Changes whenever the numbers may change for equal bodies.
        joints: Whose errors are averaged, and which Procrustes brings together.
        root: The mean of these comes to the origin first.
        turned: Whose rotations, in the world, are compared; none where it compares no angles.
    """

    name: str
    version: int
    joints: tuple[str, ...]
    root: tuple[str, ...]
    turned: tuple[str, ...] = ()


#: SMPL's 24 joints, about the middle of the hips; angles of nine.
EMDB = BodyProtocol(
    *("body-emdb", 1, SMPL_JOINTS, ("left_hip", "right_hip")),
    turned=tuple(SMPL_JOINTS[k] for k in (0, 1, 2, 4, 5, 16, 17, 18, 19)),
)
#: The 14 joints of LSP, regressed as for Human3.6M, about its pelvis, which is not one of them.
THREEDPW14 = BodyProtocol("body-3dpw14", 1, LSP_JOINTS, ("pelvis",))
BODY_PROTOCOLS: Mapping[str, BodyProtocol] = {each.name: each for each in (EMDB, THREEDPW14)}


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """One body.

    Attributes:
        joints: (3,) metres, by name.
        vertices: (V, 3) metres, or None.
        rotations: (3, 3) of each joint, in the world, by name; empty where they are not known.
    """

    joints: Mapping[str, Floats]
    vertices: Floats | None = None
    rotations: Mapping[str, Floats] | None = None


def body_numbers(
    predicted: BodyPose, truth: BodyPose, protocol: BodyProtocol
) -> dict[str, MetricValue]:
    """MPJPE and PA-MPJPE in mm; PVE and PA-PVE where both have vertices, MPJAE where rotations.

    Procrustes is from the joints alone, with the scale of least squares and without reflection, and
    is applied to vertices and rotations as well.

    Raises:
        DataError: a joint that a body does not have, or vertices that are not the same.
    """
    mine, true = (_rooted(body, protocol) for body in (predicted, truth))
    scale, turn, shift = procrustes(mine.joints, true.joints)
    found = {
        "mpjpe": _mean_mm(mine.joints, true.joints),
        "pa_mpjpe": _mean_mm(scale * mine.joints @ turn.T + shift, true.joints),
    }
    if mine.vertices is not None and true.vertices is not None:
        if mine.vertices.shape != true.vertices.shape:
            raise DataError(
                "two bodies cannot be compared vertex by vertex",
                expected=str(true.vertices.shape),
                got=str(mine.vertices.shape),
            )
        found["pve"] = _mean_mm(mine.vertices, true.vertices)
        moved = scale * mine.vertices @ turn.T + shift
        found["pa_pve"] = _mean_mm(moved, true.vertices)
    if protocol.turned and predicted.rotations and truth.rotations:
        mine_r = _of(predicted.rotations, protocol.turned)
        true_r = _of(truth.rotations, protocol.turned)
        found["mpjae"] = _mean_deg(mine_r, true_r)
        found["pa_mpjae"] = _mean_deg(turn @ mine_r, true_r)
    return found


def procrustes(moving: Floats, fixed: Floats) -> tuple[float, Floats, Floats]:
    """Scale, (3, 3) rotation and (3,) shift that bring (N, 3) points nearest to (N, 3) others."""
    middle, target = moving.mean(axis=0), fixed.mean(axis=0)
    centred = moving - middle
    left, sizes, right = np.linalg.svd((fixed - target).T @ centred)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    turn = (left * sign) @ right
    scale = float((sizes * sign).sum() / (centred**2).sum())
    return scale, turn, target - scale * turn @ middle


@dataclass(frozen=True, slots=True, eq=False)
class _Rooted:
    joints: Floats
    vertices: Floats | None


def _rooted(body: BodyPose, protocol: BodyProtocol) -> _Rooted:
    root = _of(body.joints, protocol.root).mean(axis=0)
    vertices = None if body.vertices is None else body.vertices - root
    return _Rooted(_of(body.joints, protocol.joints) - root, vertices)


def _of(values: Mapping[str, Floats], names: tuple[str, ...]) -> Floats:
    missing = [name for name in names if name not in values]
    if missing:
        raise DataError(
            "a body lacks joints of the protocol",
            expected=", ".join(names),
            got=f"no {', '.join(missing)}",
        )
    return np.stack([values[name] for name in names])


def _mean_mm(mine: Floats, true: Floats) -> MetricValue:
    lengths = np.linalg.norm(mine - true, axis=1) * MM_PER_METRE
    return MetricValue(float(lengths.mean()), Unit.millimetre.value, len(lengths), 0.0)


def _mean_deg(mine: Floats, true: Floats) -> MetricValue:
    """Mean angle of the turns between (N, 3, 3) rotations."""
    between = mine @ np.swapaxes(true, 1, 2)
    axis = np.stack([between[:, i, j] - between[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], 1)
    along = np.trace(between, axis1=1, axis2=2) - 1
    angles = np.degrees(np.arctan2(np.linalg.norm(axis, axis=1), along))
    return MetricValue(float(angles.mean()), Unit.degree.value, len(angles), 0.0)
