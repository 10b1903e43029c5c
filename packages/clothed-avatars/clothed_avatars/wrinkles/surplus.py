"""How much more cloth than room there is, edge by edge: what wrinkles come from.

Three sources add up. Cloth is cut longer than the body it hangs on, most at elbows, knees, cuffs,
armpits, waist and crotch. The pose brings parts of the body nearer to each other, and the cloth
between them folds across that direction; where it is pulled, folds go. The drape, whose cloth is
coarse, left some of its length unused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clothed_avatars.clothes.patterns import Piece
from clothed_avatars.clothes.weaves import Weave
from clothed_avatars.mesh.noise import smooth_noise
from clothed_avatars.mesh.quads import Floats, Ints
from clothed_avatars.people.body import AvatarBody
from clothed_avatars.people.landmarks import Heights, heights, ramp
from clothed_avatars.wrinkles.construction import Construction

_LIMB, _TRUNK, _AROUND = 0.065, 0.035, 0.006
_JOINT, _END, _PULL = 0.14, 0.16, 0.09
_HANGING = 0.12
"""What is left of the surplus down the trunk where cloth hangs free below the hip."""
_HANGING_AROUND = 0.030
_WEIGHT = 0.85
"""How much of the creases of wear its weight takes out of hanging cloth."""
_CAP = 0.30
_POSE_GAIN, _POSE_CAP = 0.8, 0.30
_TAUT = 3.5
"""How quickly folds vanish where the pose pulls: at 20 % of stretch half of them are left."""
_DRAPE_CAP = 0.30
_WANDER_M, _WANDER_SIZE_M = 0.10, 0.26
_FINE_M, _FINE_SIZE_M = 0.010, 0.05
_BLOTCH_M, _BLOTCH = 0.14, 1.4
"""Size of patches of more and of less surplus, and how much they differ."""
_CREASE_M = 0.16
"""How far creases of wear keep one direction."""
_ARMS = ("upperarm01", "lowerarm01", "wrist")


@dataclass(frozen=True)
class Sewn:
    """A garment's vertices at one level of fineness.

    draped (V,3): at rest on the posed body. cut (V,3): as cut, around the unposed body. carried
    (V,3): the cut moved with the bones into the pose. pattern (V,3) and part (V,): see ``Piece``.
    """

    draped: Floats
    cut: Floats
    carried: Floats
    pattern: Floats
    part: Ints


@dataclass(frozen=True)
class Tailoring:
    """Whose garment it is, which one, of what cloth, how strongly it creases, the seed, and how it
    is sewn.
    """

    body: AvatarBody
    piece: Piece
    weave: Weave
    strength: float
    seed: int
    construction: Construction | None = None

    @property
    def is_top(self) -> bool:
        """Whether the garment's limbs are sleeves."""
        return self.piece.name != "bottom"


def _bump(distance: Floats, width: float) -> Floats:
    return np.exp(-((distance / width) ** 2))


def _sleeve(tailoring: Tailoring, pattern: Floats, side: str) -> Floats:
    """Surplus along one sleeve: more at the elbow, and at the cuff of a long one."""
    shoulder, elbow, wrist = (tailoring.body.joint(f"{bone}.{side}") for bone in _ARMS)
    axis = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    down = (pattern - shoulder) @ axis
    to_elbow, to_wrist = (elbow - shoulder) @ axis, (wrist - shoulder) @ axis
    found = _LIMB + _JOINT * _bump(down - to_elbow, 0.12)
    end = min(float(to_wrist), float(np.percentile(down, 99.5)))
    return found + _END * _bump(down - end, 0.08) if end > 0.8 * to_wrist else found


def _leg(tailoring: Tailoring, pattern: Floats, side: str) -> Floats:
    """Surplus down one trouser leg: more at the knee, and at the end of a long one."""
    knee = float(tailoring.body.joint(f"lowerleg01.{side}")[1])
    ankle = float(tailoring.body.joint(f"foot.{side}")[1])
    found = 0.85 * _LIMB + _JOINT * _bump(pattern[:, 1] - knee, 0.13)
    end = max(ankle, float(np.percentile(pattern[:, 1], 0.5)))
    return found + _END * _bump(pattern[:, 1] - end, 0.12) if end < ankle + 0.15 else found


def _hanging(at: Heights, sewn: Sewn) -> Floats:
    """(V,) 1 where cloth hangs free below the hip, as in skirts, dresses and coats, 0 elsewhere."""
    return ramp(sewn.pattern[:, 1], at.hip + 0.02, at.hip - 0.10) * (sewn.part == 0)


def _cut_surplus(tailoring: Tailoring, sewn: Sewn) -> tuple[Floats, Floats]:
    """(V,) shares by which the cloth is longer along and around limbs and trunk."""
    body, pattern = tailoring.body, sewn.pattern
    at = heights(body)
    along = np.full(len(pattern), _TRUNK)
    around = np.full(len(pattern), _AROUND)
    for value, side in ((1, "L"), (2, "R")):
        own = sewn.part == value
        if own.any():
            limb = _sleeve if tailoring.is_top else _leg
            along[own] = limb(tailoring, pattern[own], side)
    hanging = _hanging(at, sewn)
    along *= 1 - (1 - _HANGING) * hanging
    around += (_HANGING_AROUND - _AROUND) * hanging
    if tailoring.is_top:
        for side in "LR":
            armpit = body.joint(f"upperarm01.{side}") + np.array([0.0, -0.07, 0.0])
            near = np.linalg.norm(pattern - armpit, axis=1)
            along += _PULL * _bump(near, 0.11)
            around += 0.5 * _PULL * _bump(near, 0.10)
        along += _PULL * _bump(pattern[:, 1] - at.waist - 0.04, 0.09) * (sewn.part == 0)
        # Shoulders carry the garment: cloth lies smooth there.
        along *= 1 - 0.6 * ramp(pattern[:, 1], at.shoulder - 0.03, at.shoulder + 0.03)
    else:
        hips = 0.5 * (body.joint("upperleg01.L") + body.joint("upperleg01.R"))
        near = np.linalg.norm((pattern - hips - [0.0, -0.09, 0.0]) * [1, 1, 0.6], axis=1)
        free = 1 - hanging
        along += 1.2 * _PULL * _bump(near, 0.15) * free
        around += 0.6 * _PULL * _bump(near, 0.13) * free
    return along, around


def _fold_coordinate(tailoring: Tailoring, sewn: Sewn) -> Floats:
    """(V,) metres in the direction in which cloth has surplus: along limbs, helical, wandering."""
    body, pattern = tailoring.body, sewn.pattern
    axis = np.tile([0.0, 1.0, 0.0], (len(pattern), 1))
    if tailoring.is_top:
        for value, side in ((1, "L"), (2, "R")):
            arm = body.joint(f"upperarm01.{side}") - body.joint(f"wrist.{side}")
            axis[sewn.part == value] = arm / np.linalg.norm(arm)
    along = np.einsum("nd,nd->n", pattern, axis)
    across = pattern - along[:, None] * axis
    draw = np.random.default_rng(tailoring.seed)
    lean = draw.normal(0, 0.4, (3, 2))
    helix = np.einsum("nd,nd->n", across[:, [0, 2]], lean[sewn.part])
    wander = _WANDER_M * smooth_noise(pattern / _WANDER_SIZE_M + 3.7, tailoring.seed + 1)
    fine = _FINE_M * smooth_noise(pattern / _FINE_SIZE_M + 1.1, tailoring.seed + 2)
    return along + helix + wander + fine


def _edge_lengths(points: Floats, ends: Ints) -> Floats:
    return np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)


def _of_ends(values: Floats, ends: Ints) -> Floats:
    return 0.5 * (values[ends[:, 0]] + values[ends[:, 1]])


def creases(pattern: Floats, ends: Ints, seed: int) -> Floats:
    """(E,) share of the creases of wear in each edge: they run any way, but not every way at once.

    0.2 along a crease and 2 across it, about 1 in the mean.
    """
    fields = [smooth_noise(pattern / _CREASE_M, seed + number) for number in range(3)]
    way = np.stack(fields, axis=1)
    way = 0.5 * (way[ends[:, 0]] + way[ends[:, 1]])
    edge = pattern[ends[:, 0]] - pattern[ends[:, 1]]
    sizes = np.maximum((way**2).sum(1) * (edge**2).sum(1), 1e-12)
    return 0.2 + 1.8 * np.einsum("ed,ed->e", way, edge) ** 2 / sizes


def surplus_of_edges(tailoring: Tailoring, sewn: Sewn, ends: Ints) -> Floats:
    """(E,) share by which each edge (E,2) wants to be longer than it lies in the drape."""
    along, around = _cut_surplus(tailoring, sewn)
    size = tailoring.strength * tailoring.weave.fullness
    patches = smooth_noise(sewn.pattern / _BLOTCH_M, tailoring.seed + 3)
    blotch = np.exp(_BLOTCH * (patches - 0.25))
    coordinate = _fold_coordinate(tailoring, sewn)
    width = np.maximum(_edge_lengths(sewn.pattern, ends), 1e-4)
    change = (coordinate[ends[:, 0]] - coordinate[ends[:, 1]]) / width
    same = sewn.part[ends[:, 0]] == sewn.part[ends[:, 1]]
    upward = (sewn.pattern[ends[:, 0], 1] - sewn.pattern[ends[:, 1], 1]) / width
    share = np.clip(np.where(same, change, upward), -1, 1) ** 2
    cut = _of_ends(along * blotch, ends) * share + _of_ends(around * blotch, ends) * (1 - share)
    lengths = [_edge_lengths(points, ends) for points in (sewn.cut, sewn.carried, sewn.draped)]
    as_cut, carried, draped = (np.maximum(length, 1e-5) for length in lengths)
    nearer = as_cut / carried - 1
    taut = np.exp(_TAUT * np.minimum(nearer, 0))
    posed = _POSE_GAIN * _of_ends(blotch, ends) * np.clip(nearer, 0, _POSE_CAP)
    worn = creases(sewn.pattern, ends, tailoring.seed + 4) * _of_ends(blotch, ends) ** 0.5
    # Its own weight pulls hanging cloth straight: creases across it would be ladders.
    worn *= 1 - _WEIGHT * share * _of_ends(_hanging(heights(tailoring.body), sewn), ends)
    wished = size * (cut + posed) * taut
    wished += tailoring.strength * tailoring.weave.crumple * worn
    unused = np.clip(as_cut / draped - 1, 0, _DRAPE_CAP)
    return _CAP * np.tanh(wished / _CAP) + min(1.0, size) * unused
