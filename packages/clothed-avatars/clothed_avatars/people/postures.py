"""Poses drawn at random: how far apart two poses are, and which a person can take.

A figure of points and thick lines, of the person's stature and girth, stands in for the body: it is
quick, and it keeps arms out of the trunk, the head, the legs and each other, so that clothes can
be draped.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clothed_avatars.mesh.quads import Floats
from clothed_avatars.people.poses import Limb, Pose, limb_direction, trunk_rotation
from harness.core.errors import DataError

_ATTEMPTS = 20_000
_FRAME_RADIUS_M = 0.52
"""How far fingertips may be from the middle: the paper's views cut at 0.59, clothes included."""
_FRAME_SLOPE, _RIG_RADIUS_M = 0.36, 3.0
"""Half the height of the frame over the distance, and how far the paper's cameras are."""
_SOLES_AND_HAIR_M = 0.035
_LEAST_HEIGHT_M = 1.43
_CLEARANCE_M = 0.025
"""What is left between an arm and the body, for two layers of cloth."""
_ARM_M = 0.042
_SAMPLES = 8

Range = tuple[float, float]


@dataclass(frozen=True)
class Figure:
    """Who takes the pose: stature in metres, the trunk's width over an average one's, and what is
    kept free above the head and below the feet because the stature is an estimate.
    """

    stature_m: float
    girth: float = 1.0
    spare_m: float = 0.0


@dataclass(frozen=True)
class _Reach:
    """Ranges of (outward, down) of a limb's upper and lower segment, degrees."""

    upper: tuple[Range, Range]
    lower: tuple[Range, Range]

    def draw(self, draw: np.random.Generator) -> Limb:
        values = [float(draw.uniform(*r)) for r in (*self.upper, *self.lower)]
        rounded = [round(value, 1) for value in values]
        return Limb((rounded[0], rounded[1]), (rounded[2], rounded[3]))


_ARMS = {
    "hanging": _Reach(((30, 140), (56, 73)), ((-15, 70), (28, 70))),
    "carrying": _Reach(((40, 135), (52, 74)), ((-25, 45), (-22, 22))),
    "raised": _Reach(((15, 85), (-22, 38)), ((-20, 60), (-40, 30))),
    "behind": _Reach(((125, 172), (44, 66)), ((60, 150), (45, 76))),
}
_STANDING_LEG = _Reach(((60, 115), (78, 87)), ((90, 180), (82, 88)))
_LEGS: dict[str, tuple[_Reach, _Reach]] = {
    "upright": (_STANDING_LEG, _STANDING_LEG),
    "apart": (
        _Reach(((70, 100), (68, 78)), ((85, 115), (72, 84))),
        _Reach(((70, 100), (68, 78)), ((85, 115), (72, 84))),
    ),
    "stepping": (
        _Reach(((5, 28), (58, 74)), ((120, 180), (78, 88))),
        _Reach(((155, 178), (72, 84)), ((165, 180), (46, 72))),
    ),
    "one leg raised": (_Reach(((5, 35), (34, 58)), ((160, 180), (62, 80))), _STANDING_LEG),
    "half sitting": (
        _Reach(((15, 42), (44, 62)), ((150, 180), (60, 78))),
        _Reach(((15, 42), (44, 62)), ((150, 180), (60, 78))),
    ),
}
KINDS = tuple(_LEGS)
"""What legs do in a drawn pose."""


def mirrored(pose: Pose) -> Pose:
    """The pose with left and right exchanged."""
    trunk, head = ((bent, -turned, -leant) for bent, turned, leant in (pose.trunk, pose.head))
    (left_arm, right_arm), (left_leg, right_leg) = pose.arms, pose.legs
    return Pose((right_arm, left_arm), (right_leg, left_leg), trunk, head)


def _directions(pose: Pose) -> Floats:
    """(8,3) of the limbs' segments, in the frame of the chest (arms) or of the hips (legs)."""
    return np.array(
        [
            limb_direction(angles, side)
            for limbs in (pose.arms, pose.legs)
            for limb, side in zip(limbs, (1, -1), strict=True)
            for angles in (limb.upper, limb.lower)
        ]
    )


def pose_distance_deg(first: Pose, second: Pose) -> float:
    """Root mean square of the angles between the eight limb segments of two poses, in degrees; of
    the second pose and its mirror image, the nearer counts. Trunk and head are left out.
    """
    ours = _directions(first)
    found = []
    for other in (second, mirrored(second)):
        cosine = np.clip((ours * _directions(other)).sum(1), -1, 1)
        found.append(np.sqrt((np.degrees(np.arccos(cosine)) ** 2).mean()))
    return float(min(found))


@dataclass(frozen=True)
class _Points:
    """The figure's joints in metres, left then right; ``chest`` turns the trunk's axes."""

    arms: Floats
    legs: Floats
    head: Floats
    waist: Floats
    chest: Floats


def _points(pose: Pose, figure: Figure) -> _Points:
    size = figure.stature_m
    chest = trunk_rotation(pose.trunk).as_matrix()
    waist = np.array([0.0, 0.61, -0.02]) * size
    arms, legs = [], []
    for limb, leg, side in zip(pose.arms, pose.legs, (1, -1), strict=True):
        shoulder = waist + chest @ (np.array([0.102 * side, 0.186, 0.022]) * size)
        elbow = shoulder + 0.156 * size * chest @ limb_direction(limb.upper, side)
        forearm = chest @ limb_direction(limb.lower, side)
        arms.append([shoulder, elbow, elbow + 0.14 * size * forearm, elbow + 0.27 * size * forearm])
        hip = np.array([0.065 * side, 0.524, 0.0]) * size
        knee = hip + 0.233 * size * limb_direction(leg.upper, side)
        ankle = knee + 0.25 * size * limb_direction(leg.lower, side)
        legs.append([hip, knee, ankle, ankle + np.array([0.0, -0.02, 0.12]) * size])
    head = waist + chest @ (np.array([0.0, 0.325, 0.035]) * size)
    return _Points(np.array(arms), np.array(legs), head, waist, chest)


def _along(points: Floats) -> Floats:
    """Samples (N,3) on the line through points (P,3)."""
    share = np.linspace(0, 1, _SAMPLES)[:, None]
    return np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(points)])


def _gap(first: Floats, second: Floats) -> float:
    """The least distance between two sets of points."""
    return float(np.linalg.norm(first[:, None] - second[None], axis=2).min())


def _arm_is_clear(figure: Figure, at: _Points, side: int) -> bool:
    """Whether forearm, hand and the lower half of the upper arm touch nothing but air."""
    size, margin = figure.stature_m, _ARM_M + _CLEARANCE_M
    shoulder, elbow = at.arms[side][:2]
    arm = _along(np.stack([0.3 * shoulder + 0.7 * elbow, *at.arms[side][1:]]))
    other = _along(at.arms[1 - side][1:])
    local = (arm - at.waist) @ at.chest
    beside = (local[:, 1] > -0.16 * size) & (local[:, 1] < 0.22 * size)
    wide = 0.092 * size * figure.girth + margin
    deep = 0.062 * size * figure.girth + margin
    inside = ((local[:, 0] / wide) ** 2 + ((local[:, 2] - 0.04 * size) / deep) ** 2 < 1) & beside
    thigh = 0.052 * size * figure.girth + margin
    legs = np.concatenate([_along(leg[:3]) for leg in at.legs])
    return not (
        inside.any()
        or _gap(arm, at.head[None]) < 0.085 * size + margin
        or _gap(arm, other) < 2 * _ARM_M + 2 * _CLEARANCE_M
        or _gap(arm, legs) < thigh
    )


def _bends_rightly(pose: Pose) -> bool:
    """Whether forearms point no further back than upper arms, and shins no further forward than
    thighs, with an elbow or knee that stays within 115 degrees.
    """
    for limbs, forward in ((pose.arms, 1.0), (pose.legs, -1.0)):
        for limb in limbs:
            upper, lower = limb_direction(limb.upper, 1), limb_direction(limb.lower, 1)
            if forward * (lower[2] - upper[2]) < -0.03:
                return False
            if upper @ lower < np.cos(np.radians(115)):
                return False
    return True


def _fits(figure: Figure, at: _Points) -> bool:
    """Whether the figure is high enough, no hand above its head, and all inside the frame."""
    crown = at.head + at.chest @ np.array([0.0, 0.065, 0.0]) * figure.stature_m
    points = np.concatenate([at.arms.reshape(-1, 3), at.legs.reshape(-1, 3), crown[None]])
    low, high = points.min(0), points.max(0)
    offset = points - 0.5 * (low + high)
    away = np.hypot(offset[:, 0], offset[:, 2])
    # What is off the middle is nearer to one of the cameras, which then sees less of its height.
    rise = np.abs(offset[:, 1]) + (_SOLES_AND_HAIR_M + figure.spare_m)
    return bool(
        high[1] - low[1] > _LEAST_HEIGHT_M
        and high[1] <= crown[1]
        and away.max() < _FRAME_RADIUS_M
        and (rise < _FRAME_SLOPE * (_RIG_RADIUS_M - away)).all()
    )


def _legs_are_apart(figure: Figure, at: _Points) -> bool:
    left, right = (_along(leg) for leg in at.legs)
    knees = 0.085 * figure.stature_m * figure.girth
    below = slice(_SAMPLES // 2, None)
    return _gap(left[below], right[below]) > max(knees, 0.12)


def is_possible(pose: Pose, figure: Figure) -> bool:
    """Whether a person can take the pose, dressed, inside the frame of the paper's photos."""
    if not _bends_rightly(pose):
        return False
    at = _points(pose, figure)
    return (
        _fits(figure, at)
        and _legs_are_apart(figure, at)
        and all(_arm_is_clear(figure, at, side) for side in (0, 1))
    )


def _once(draw: np.random.Generator, kind: str) -> Pose:
    names = sorted(_ARMS)
    arms = [_ARMS[names[int(draw.integers(len(names)))]].draw(draw) for _ in range(2)]
    legs = [reach.draw(draw) for reach in _LEGS[kind]]
    if draw.random() < 0.5:
        legs.reverse()
    low = (8.0, 22.0) if kind == "half sitting" else (-3.0, 9.0)
    ranges = (low, (-24.0, 24.0), (-7.0, 7.0), (-9.0, 12.0), (-30.0, 30.0), (-7.0, 7.0))
    bent, turned, leant, nod, look, tilt = (round(float(draw.uniform(*r)), 1) for r in ranges)
    return Pose((arms[0], arms[1]), (legs[0], legs[1]), (bent, turned, leant), (nod, look, tilt))


def draw_pose(
    draw: np.random.Generator,
    figure: Figure,
    avoided: Sequence[Pose],
    least_deg: float,
    kinds: Sequence[str] = KINDS,
) -> tuple[str, Pose]:
    """The kind and the pose: one that is possible and at least ``least_deg`` from all avoided.

    Raises:
        DataError: no such pose was found.
    """
    kind = kinds[int(draw.integers(len(kinds)))]
    for attempt in range(_ATTEMPTS):
        if attempt % 200 == 199:
            # Not every person can take every kind of pose: a short one is too low half sitting.
            kind = kinds[int(draw.integers(len(kinds)))]
        pose = _once(draw, kind)
        if is_possible(pose, figure) and all(
            pose_distance_deg(pose, other) >= least_deg for other in avoided
        ):
            return kind, pose
    raise DataError(
        f"no pose was found in {_ATTEMPTS} draws",
        expected=f"one that is possible and {least_deg:.0f} degrees from {len(avoided)} others",
        hint="Ask for a smaller distance",
    )
