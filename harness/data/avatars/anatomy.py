"""Where on the body a point is: on which limb, how far down it, and around it.

Garments are cut and folded in these coordinates of the rest pose, so one pattern fits every body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.data.avatars.body import PosedBody
from harness.data.avatars.surface import Floats, Patch

__all__ = [
    "LIMBS",
    "LimbPlace",
    "limb_places",
    "pattern_coordinates",
    "pattern_places",
    "torso_axis",
]

LIMBS = ("arm.L", "arm.R", "leg.L", "leg.R")

_CHAINS = {
    "arm": ("upperarm01", "lowerarm01", "wrist"),
    "leg": ("upperleg01", "lowerleg01", "foot"),
}
_MEMBERS = {
    "arm": ("upperarm", "lowerarm", "wrist", "finger", "metacarpal"),
    "leg": ("upperleg", "lowerleg", "foot", "toe"),
}


_TRUNK_RADIUS, _SLEEVE_RADIUS = 0.15, 0.055
"""Metres of cloth per radian."""


@dataclass(frozen=True)
class LimbPlace:
    """Places of vertices (V,) with respect to one limb, in the rest pose.

    member: share of the limb's bones in the skinning, 0 to 1. along: 0 at shoulder or hip, 1 at
    elbow or knee, 2 at wrist or ankle, going on linearly. length: metres from the shoulder or hip.
    radial (V,3): from the limb's axis to the vertex, metres.
    """

    member: Floats
    along: Floats
    length: Floats
    radial: Floats


def _limb_place(patch: Patch, body: PosedBody, limb: str) -> LimbPlace:
    kind, side = limb.split(".")
    bones = [
        i
        for i, name in enumerate(body.bone_names)
        if name.endswith(f".{side}") and name.startswith(_MEMBERS[kind])
    ]
    member = np.asarray(patch.weights[:, bones].sum(1)).ravel()
    a, b, c = (body.joint_rest(f"{bone}.{side}") for bone in _CHAINS[kind])

    def project(start: Floats, end: Floats) -> tuple[Floats, Floats, float]:
        axis = end - start
        share = (patch.vertices - start) @ axis / (axis @ axis)
        return share, patch.vertices - start - share[:, None] * axis, float(np.linalg.norm(axis))

    upper, upper_radial, upper_length = project(a, b)
    lower, lower_radial, lower_length = project(b, c)
    beyond = np.clip((upper - 1 + lower) * 4 + 0.5, 0, 1)[
        :, None
    ]  # soft change of axis at the joint
    share = beyond[:, 0]
    along = upper * (1 - share) + (1 + lower) * share
    length = upper * upper_length * (1 - share) + (upper_length + lower * lower_length) * share
    return LimbPlace(member, along, length, upper_radial * (1 - beyond) + lower_radial * beyond)


def limb_places(patch: Patch, body: PosedBody) -> dict[str, LimbPlace]:
    """The places of a patch's vertices with respect to each of the four limbs."""
    return {limb: _limb_place(patch, body, limb) for limb in LIMBS}


def torso_axis(vertices: Floats, body: PosedBody) -> Floats:
    """The point (V,3) of the spine at each vertex's height, in the rest pose."""
    spine = np.array([body.joint_rest(f"spine0{i}") for i in (5, 4, 3, 2, 1)])
    middle_z = np.interp(vertices[:, 1], spine[:, 1], spine[:, 2])
    # The spine runs behind the trunk's middle; half a hand forward is the middle.
    return np.stack([np.zeros(len(vertices)), vertices[:, 1], middle_z + 0.03], axis=1)


def pattern_places(patch: Patch, body: PosedBody) -> Floats:
    """What ``pattern_coordinates`` needs of each vertex, as (V,11) values that interpolate well."""
    offset = patch.vertices - torso_axis(patch.vertices, body)
    columns = [offset[:, 0], offset[:, 2], patch.vertices[:, 1]]
    for limb in ("arm.L", "arm.R"):
        arm = _limb_place(patch, body, limb)
        columns += [arm.member, arm.length, arm.radial[:, 1], arm.radial[:, 2]]
    return np.stack(columns, 1)


def pattern_coordinates(places: Floats) -> Floats:
    """Metres (N,2) round and along: the trunk by the spine, sleeves by the arm, a seam between."""
    around = np.stack([np.arctan2(places[:, 0], places[:, 1]) * _TRUNK_RADIUS, places[:, 2]], 1)
    for first in (3, 7):
        member, length, up, ahead = places[:, first : first + 4].T
        sleeve = np.stack([np.arctan2(up, ahead) * _SLEEVE_RADIUS, -length], 1)
        around = np.where((member > 0.6)[:, None], sleeve, around)
    return around
