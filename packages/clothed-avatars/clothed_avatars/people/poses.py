"""The written pose library: where each limb points, and the joint rotations that take it there.

A limb segment is pointed with two angles in the frame of the chest (arms) or of the hips (legs):
``outward`` is the compass direction, 0 forward, 90 to the limb's own side, 180 backward, negative
across the body; ``down`` is the slope, 90 straight down, 0 level, negative upward. Turning a bone
by the least rotation keeps elbows and knees within what a joint can do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from clothed_avatars.mesh.quads import Floats

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from clothed_avatars.people.body import AvatarBody

Degrees = tuple[float, float, float]
_CHAINS = {
    "arm": (("upperarm01", "lowerarm01"), ("lowerarm01", "wrist")),
    "leg": (("upperleg01", "lowerleg01"), ("lowerleg01", "foot")),
}
_TRUNK = ("spine04", "spine03", "spine02")
_NECK = ("neck02", "head")


@dataclass(frozen=True)
class Limb:
    """(outward, down) in degrees of the upper and of the lower segment."""

    upper: tuple[float, float]
    lower: tuple[float, float]


@dataclass(frozen=True)
class Pose:
    """Limbs, and how trunk and head are held: bent forward, turned left, leant left, degrees."""

    arms: tuple[Limb, Limb]
    legs: tuple[Limb, Limb]
    trunk: Degrees = (0.0, 0.0, 0.0)
    head: Degrees = (0.0, 0.0, 0.0)


def _pair(limb: Limb) -> tuple[Limb, Limb]:
    return limb, limb


_STRAIGHT = Limb((90, 86), (90, 88))

POSES: Mapping[str, Pose] = MappingProxyType(
    {
        "standing": Pose(_pair(Limb((80, 72), (40, 70))), _pair(_STRAIGHT)),
        "relaxed": Pose(
            (Limb((100, 70), (45, 66)), Limb((70, 68), (30, 55))),
            (Limb((70, 84), (-90, 88)), Limb((90, 85), (180, 86))),
            trunk=(2, 4, -2),
            head=(5, -12, 3),
        ),
        "walking": Pose(
            (Limb((20, 58), (0, 32)), Limb((150, 62), (60, 64))),
            (Limb((170, 76), (180, 60)), Limb((10, 70), (-10, 88))),
            trunk=(3, 8, 0),
            head=(0, -4, 0),
        ),
        "hands-on-hips": Pose(
            _pair(Limb((105, 42), (-52, 36))), _pair(Limb((80, 83), (90, 88))), head=(0, 10, 0)
        ),
        "reaching": Pose(
            (Limb((35, -12), (20, -22)), Limb((85, 70), (40, 60))),
            (Limb((60, 84), (120, 88)), Limb((80, 82), (180, 86))),
            trunk=(6, -8, 0),
            head=(-8, 10, 0),
        ),
        "turning": Pose(
            (Limb((70, 66), (-10, 40)), Limb((110, 64), (70, 58))),
            (Limb((80, 82), (120, 87)), Limb((60, 80), (120, 86))),
            trunk=(3, 26, 0),
            head=(0, 22, 0),
        ),
        "knee-bent": Pose(
            (Limb((85, 64), (20, 50)), Limb((80, 68), (30, 60))),
            (Limb((15, 40), (180, 72)), Limb((95, 87), (95, 88))),
            trunk=(4, 0, 0),
            head=(4, 0, 0),
        ),
        "arms-close": Pose(
            _pair(Limb((75, 77), (20, 75))), _pair(Limb((90, 88), (90, 89))), head=(3, 0, 0)
        ),
        "arms-crossed": Pose(
            (Limb((62, 62), (-58, 10)), Limb((62, 60), (-62, -6))), _pair(Limb((90, 84), (90, 88)))
        ),
        "wide-stance": Pose(
            (Limb((95, 58), (60, 52)), Limb((90, 55), (50, 40))),
            _pair(Limb((85, 74), (95, 80))),
            trunk=(0, -6, 2),
            head=(2, -10, 0),
        ),
    }
)


def limb_direction(outward_down: tuple[float, float], side: int) -> Floats:
    """The unit vector (3,) of two angles in degrees, in the frame of the chest or of the hips;
    ``side`` is 1 on the left and -1 on the right.
    """
    outward, down = np.radians(outward_down)
    return np.array(
        [side * np.sin(outward) * np.cos(down), -np.sin(down), np.cos(outward) * np.cos(down)]
    )


def trunk_rotation(held: Degrees) -> Rotation:
    """The rotation of a trunk or head that is bent forward, turned left and leant left."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("yxz", np.radians([held[k] for k in (1, 0, 2)]))


def _least_rotation(start: Floats, end: Floats) -> Floats:
    """The rotation vector of the least rotation from one direction to another."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(start, end)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.zeros(3)
    return axis / sine * np.arctan2(sine, start @ end)


def _limb_rotations(
    body: AvatarBody, kind: str, limb: Limb, side: str, base: Floats
) -> dict[str, Floats]:
    from scipy.spatial.transform import Rotation

    out: dict[str, Floats] = {}
    carried = Rotation.from_matrix(base)
    for (bone, tip), aim in zip(_CHAINS[kind], (limb.upper, limb.lower), strict=True):
        rest = body.joint(f"{tip}.{side}") - body.joint(f"{bone}.{side}")
        goal = base @ limb_direction(aim, 1 if side == "L" else -1)
        turn = _least_rotation(carried.apply(rest), goal)
        out[f"{bone}.{side}"] = carried.inv().apply(turn)
        carried = Rotation.from_rotvec(turn) * carried
    if kind == "leg":
        out[f"foot.{side}"] = carried.inv().as_rotvec()  # soles stay level
    return out


def joint_rotations(
    body: AvatarBody, pose: Pose, reach: float = 1.0, bend: float = 1.0
) -> dict[str, Floats]:
    """Rotation vectors (3,) in radians by bone, about the product's axes at the unposed joint.

    ``reach`` and ``bend`` (0 to 1) are how far the pose, and its elbows, have been taken: the path
    along which clothes are draped.
    """
    from scipy.spatial.transform import Rotation

    trunk, head = trunk_rotation(pose.trunk), trunk_rotation(pose.head)
    out = {bone: trunk.as_rotvec() * reach / len(_TRUNK) for bone in _TRUNK}
    out |= {bone: head.as_rotvec() * reach / len(_NECK) for bone in _NECK}
    chest = Rotation.from_rotvec(trunk.as_rotvec() * reach).as_matrix()
    for k, side in enumerate("LR"):
        for kind, limbs, base in (("arm", pose.arms, chest), ("leg", pose.legs, np.eye(3))):
            turns = _limb_rotations(body, kind, limbs[k], side, base)
            for bone, turn in turns.items():
                out[bone] = turn * (bend if bone.startswith("lowerarm") else reach)
    return out
