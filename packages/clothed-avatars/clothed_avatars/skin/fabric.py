"""Woven, knitted and printed patterns over the cloth as it was cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clothed_avatars.clothes.wardrobe import Fabric
from clothed_avatars.mesh.noise import folds, smooth_noise
from clothed_avatars.mesh.quads import Floats
from clothed_avatars.people.body import AvatarBody
from clothed_avatars.people.landmarks import trunk_axis

_HEM_M = 0.02
_FRONT_M = 0.10
"""How far before the spine the front of the chest begins."""
_TRUNK_RADIUS_M = 0.15
_LIMB_RADIUS_M = {"arm": 0.06, "leg": 0.09}
_LIMBS = {"arm": ("upperarm01", "wrist"), "leg": ("upperleg01", "foot")}


@dataclass(frozen=True)
class _Cloth:
    """Per texel: metres around and down the cloth, place (N,3) relative to the chest; the seed."""

    around: Floats
    down: Floats
    from_chest: Floats
    seed: int


def mix(base: Floats, colour: object, share: Floats) -> Floats:
    """Colours (N,3) taken towards another by shares (N,)."""
    return base + share[:, None] * (np.asarray(colour, float) - base)


def band(values: Floats, half_width: float, soft: float) -> Floats:
    """1 where |values| < half_width, falling to 0 over ``soft``."""
    return np.clip((half_width - np.abs(values)) / soft + 0.5, 0, 1)


def _cloth_coordinates(body: AvatarBody, place: Floats, limb: str) -> tuple[Floats, Floats]:
    """(N,) metres around and (N,) metres down the cloth, sleeves and legs along their own limb."""
    points, part = place[:, :3], np.rint(place[:, 3])
    axis = trunk_axis(body, points[:, 1])
    offset = points - axis
    around = _TRUNK_RADIUS_M * np.arctan2(offset[:, 0], offset[:, 2])
    down = points[:, 1].copy()
    for value, side in ((1, "L"), (2, "R")):
        own = part == value
        start, end = (body.joint(f"{bone}.{side}") for bone in _LIMBS[limb])
        along = (end - start) / np.linalg.norm(end - start)
        across = np.cross(along, [0.0, 0, 1])
        across /= np.linalg.norm(across)
        local = points[own] - start
        third = np.cross(along, across)
        around[own] = _LIMB_RADIUS_M[limb] * np.arctan2(local @ across, local @ third)
        down[own] = -(local @ along)
    return around, down


def _stripes(cloth: _Cloth, size: float) -> Floats:
    return band((cloth.down / (0.045 * size)) % 1 - 0.5, 0.22, 0.04)


def _checks(cloth: _Cloth, size: float) -> Floats:
    across = band((cloth.around / (0.07 * size)) % 1 - 0.5, 0.22, 0.03)
    along = band((cloth.down / (0.07 * size)) % 1 - 0.5, 0.22, 0.03)
    return 0.45 * across + 0.45 * along


def _dots(cloth: _Cloth, size: float) -> Floats:
    cell = np.stack([cloth.around, cloth.down], axis=1) / (0.05 * size)
    cell[:, 0] += 0.5 * (np.floor(cell[:, 1]) % 2)
    return band(np.linalg.norm(cell % 1 - 0.5, axis=1), 0.24, 0.05)


def _leaves(cloth: _Cloth, size: float) -> Floats:
    """Scattered leaves: lens shapes turned at random, one per cell."""
    cell = np.stack([cloth.around, cloth.down], axis=1) / (0.075 * size)
    cell[:, 0] += 0.5 * (np.floor(cell[:, 1]) % 2)
    number = np.floor(cell)
    turn = 2.4 * (number[:, 0] * 12.9898 + number[:, 1] * 78.233) % 6.28
    u, v = (cell - number - 0.5).T
    u, v = np.cos(turn) * u - np.sin(turn) * v, np.sin(turn) * u + np.cos(turn) * v
    lens = np.maximum(np.hypot(u, v + 0.28), np.hypot(u, v - 0.28))
    return band(lens, 0.47, 0.03) * (1 - 0.6 * band(u, 0.02, 0.02))


def _knit(cloth: _Cloth, size: float) -> Floats:
    rib = np.sin(cloth.around * 2 * np.pi / (0.012 * size))
    return np.clip(0.10 + 0.10 * rib + 0.05 * smooth_noise(cloth.from_chest * 60, cloth.seed), 0, 1)


def _denim(cloth: _Cloth, size: float) -> Floats:
    worn = folds(cloth.from_chest * [6, 2, 6], cloth.seed + 5)
    weave = np.sin((cloth.around + cloth.down) * 2 * np.pi / (0.006 * size))
    return np.clip(0.35 * worn - 0.1 + 0.06 * weave, 0, 1)


def _print(cloth: _Cloth, size: float) -> Floats:
    """A ring with a wave through it, on the chest."""
    x, y, z = cloth.from_chest.T / [[size], [size], [1.0]]
    ring = band(np.hypot(x, y) - 0.075, 0.014, 0.004)
    wave = band(y - 0.025 * np.sin(x * 30), 0.018, 0.004) * (np.abs(x) < 0.12)
    return (z > _FRONT_M) * np.maximum(ring, wave)


_PATTERNS = {
    "plain": lambda cloth, _size: np.zeros(len(cloth.around)),
    "stripes": _stripes,
    "checks": _checks,
    "dots": _dots,
    "leaves": _leaves,
    "knit": _knit,
    "denim": _denim,
    "print": _print,
}


def cloth_colour(fabric: Fabric, body: AvatarBody, place: Floats, limb: str, seed: int) -> Floats:
    """Colours (N,3) of cloth at places (N,5): pattern, weave, and the hem's seam.

    ``limb``: whether the cloth's limbs are those of an ``arm`` or a ``leg``. A print is centred on
    the chest.
    """
    points, hem = place[:, :3], place[:, 4]
    chest = body.joint("spine01") + np.array([0.0, -0.09, 0.0])
    around, down = _cloth_coordinates(body, place, limb)
    base = np.tile(np.asarray(fabric.colour, float), (len(points), 1))
    cloth = _Cloth(around, down, points - chest, seed)
    base = mix(base, fabric.second, _PATTERNS[fabric.pattern](cloth, fabric.scale))
    weave = 1 + 0.04 * smooth_noise(points * 160, seed) + 0.05 * smooth_noise(points * 12, seed + 1)
    seam = 0.22 * band(hem - _HEM_M, 0.0012, 0.001) + 0.06 * (hem < _HEM_M)
    return base * (weave - seam)[:, None]
