"""Where on the unposed body a point is: heights, and how far along which limb.

Clothes are cut in these coordinates, so one cut fits every body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clothed_avatars.mesh.quads import Floats, SparseMatrix
from clothed_avatars.people.body import SKIN_VERTICES, AvatarBody

_CHAINS = {
    "arm": ("upperarm01", "lowerarm01", "wrist"),
    "leg": ("upperleg01", "lowerleg01", "foot"),
}
_MEMBERS = {
    "arm": ("upperarm", "lowerarm", "wrist", "finger", "metacarpal"),
    "leg": ("upperleg", "lowerleg", "foot", "toe"),
    "neck": ("neck", "head", "eye"),
}
_TRUNK = ("spine05", "spine04", "spine03", "spine02", "spine01", "neck01")


def ramp(values: Floats, low: float, high: float) -> Floats:
    """0 at ``low``, 1 at ``high``, smooth between; ``low`` may be the larger."""
    share = np.clip((values - low) / (high - low), 0, 1)
    return share * share * (3 - 2 * share)


@dataclass(frozen=True)
class Heights:
    """y in metres of landmarks of the unposed body."""

    neck: float
    shoulder: float
    waist: float
    hip: float
    crotch: float
    ankle: float
    ground: float


def heights(body: AvatarBody) -> Heights:
    """The landmarks of a body."""
    skin = body.vertices[:SKIN_VERTICES]
    middle = skin[(np.abs(skin[:, 0]) < 0.01) & (skin[:, 1] < 0.1)]
    return Heights(
        neck=float(body.joint("neck01")[1]),
        shoulder=float(body.joint("upperarm01.L")[1]),
        waist=float(body.joint("spine04")[1]) - 0.02,
        hip=float(body.joint("upperleg01.L")[1]),
        crotch=float(middle[:, 1].min()),
        ankle=float(body.joint("foot.L")[1]),
        ground=float(skin[:, 1].min()),
    )


@dataclass(frozen=True)
class HeadPlace:
    """Centre (3,) of the head, and its highest and rearmost coordinates, unposed, metres."""

    centre: Floats
    top: float
    back: float


def head_place(body: AvatarBody) -> HeadPlace:
    """Where the head of an unposed body is."""
    skin = body.vertices[:SKIN_VERTICES]
    share = body.members("head")[:SKIN_VERTICES]
    own = skin[share > 0.5]
    eyes = body.vertices[body.quads("eyes")].mean((0, 1))
    middle = 0.5 * (own[:, 2].min() + own[:, 2].max())
    centre = np.array([0.0, eyes[1] + 0.012, middle - 0.012])
    return HeadPlace(centre, float(own[:, 1].max()), float(own[:, 2].min()))


def falling_weights(body: AvatarBody, points: Floats) -> SparseMatrix:
    """Skinning weights of what falls from the head: it follows the chest below the neck."""
    from scipy.sparse import csr_matrix

    high, low = body.joint("head")[1], body.joint("spine01")[1] + 0.06
    share = np.clip((points[:, 1] - low) / (high - low), 0, 1)
    weights = np.zeros((len(points), len(body.bone_names)))
    weights[:, body.bone_names.index("head")] = share
    weights[:, body.bone_names.index("spine01")] = 1 - share
    return csr_matrix(weights)


@dataclass(frozen=True)
class Places:
    """Per vertex: share of arm, leg and neck in its skinning; share of the way down its arm and leg
    (0 shoulder or hip, 1 wrist or ankle) and the nearest point (V,3) of that limb's axis.
    """

    arm: Floats
    leg: Floats
    neck: Floats
    down_arm: Floats
    down_leg: Floats
    arm_axis: Floats
    leg_axis: Floats


def _along(points: Floats, joints: Floats) -> tuple[Floats, Floats]:
    """Where each point is nearest to a line of joints (J,3): share of its length, and the place."""
    lengths = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    start = np.concatenate([[0.0], np.cumsum(lengths)])
    nearest = np.full(len(points), np.inf)
    share, place = np.zeros(len(points)), np.zeros_like(points)
    for k, length in enumerate(lengths):
        axis = joints[k + 1] - joints[k]
        # The first and the last segment go on beyond their ends.
        low, high = (-9.0 if k == 0 else 0.0), (9.0 if k == len(lengths) - 1 else 1.0)
        t = np.clip((points - joints[k]) @ axis / length**2, low, high)
        candidate = joints[k] + t[:, None] * axis
        distance = np.linalg.norm(points - candidate, axis=1)
        better = distance < nearest
        nearest[better], place[better] = distance[better], candidate[better]
        share[better] = (start[k] + t[better] * length) / start[-1]
    return share, place


def places(body: AvatarBody, vertices: Floats, weights: SparseMatrix) -> Places:
    """The places of vertices (V,3) with given skinning weights."""
    left = vertices[:, 0] > 0

    def member(kind: str) -> Floats:
        chosen = [k for k, name in enumerate(body.bone_names) if name.startswith(_MEMBERS[kind])]
        return np.asarray(weights[:, chosen].sum(1)).ravel()

    def limb(kind: str) -> tuple[Floats, Floats]:
        sides = [
            _along(vertices, np.array([body.joint(f"{bone}.{side}") for bone in _CHAINS[kind]]))
            for side in "LR"
        ]
        return np.where(left, sides[0][0], sides[1][0]), np.where(
            left[:, None], sides[0][1], sides[1][1]
        )

    down_arm, arm_axis = limb("arm")
    down_leg, leg_axis = limb("leg")
    return Places(
        member("arm"), member("leg"), member("neck"), down_arm, down_leg, arm_axis, leg_axis
    )


def trunk_axis(body: AvatarBody, y: Floats) -> Floats:
    """The middle (N,3) of the trunk at heights (N,)."""
    spine = np.array([body.joint(bone) for bone in _TRUNK])
    # The spine runs behind the trunk's middle; a few fingers forward is the middle.
    return np.stack([0 * y, y, np.interp(y, spine[:, 1], spine[:, 2]) + 0.035], axis=1)
