"""The colour of a texel from where it is on the resting body: fabric, skin, face, hair, shoes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from harness.core.hashing import derive_seed
from harness.data.avatars.body import PosedBody, mask_at
from harness.data.avatars.hair import HEAD_UV
from harness.data.avatars.noise import folds, smooth_noise
from harness.data.avatars.recipe import AvatarRecipe
from harness.data.avatars.surface import Floats
from harness.data.avatars.texture import Texels
from harness.data.avatars.wardrobe import Fabric

__all__ = ["fabric_colour", "painters"]


def _mix(base: Floats, colour: object, share: Floats) -> Floats:
    return base + share[:, None] * (np.asarray(colour, float) - base)


def _band(values: Floats, half_width: float, soft: float) -> Floats:
    """1 where |values| < half_width, falling to 0 over ``soft``."""
    return np.clip((half_width - np.abs(values)) / soft + 0.5, 0, 1)


def _pattern(fabric: Fabric, texels: Texels, chest: Floats, seed: int) -> Floats:
    """Share (N,) of the second colour."""
    rest = texels.rest
    x, y = texels.pattern.T
    if fabric.pattern == "stripes":
        return _band((y * 100 / 4.5) % 1 - 0.5, 0.22, 0.04)
    if fabric.pattern == "checks":
        across = _band((x * 100 / 7) % 1 - 0.5, 0.22, 0.03)
        down = _band((y * 100 / 7) % 1 - 0.5, 0.22, 0.03)
        return 0.45 * across + 0.45 * down
    if fabric.pattern == "dots":
        cell = np.stack([x * 100 / 5, y * 100 / 5], 1)
        cell[:, 0] += 0.5 * (np.floor(cell[:, 1]) % 2)
        return _band(np.linalg.norm(cell % 1 - 0.5, axis=1), 0.24, 0.05)
    if fabric.pattern == "print":
        local = (rest - chest)[:, :2]
        front = (rest[:, 2] > chest[2]).astype(float)
        ring = _band(np.linalg.norm(local, axis=1) - 0.075, 0.014, 0.004)
        bar = _band(local[:, 1] - 0.25 * np.sin(local[:, 0] * 30) * 0.1, 0.018, 0.004)
        return front * np.maximum(ring, bar * (np.abs(local[:, 0]) < 0.12))
    if fabric.pattern == "denim":
        worn = folds(rest * [6, 2, 6], seed + 5)
        weave = np.sin((x + y) * 2 * np.pi / 0.004)
        return np.clip(0.35 * worn - 0.1 + 0.06 * weave, 0, 1)
    return np.zeros(len(x))


def fabric_colour(fabric: Fabric, texels: Texels, chest: Floats, seed: int) -> Floats:
    """Colours (N,3) of a fabric under texels; ``chest`` (3,) is a print's centre."""
    rest = texels.rest
    base = np.tile(np.asarray(fabric.colour, float), (len(rest), 1))
    base = _mix(base, fabric.second, _pattern(fabric, texels, chest, seed))
    weave = 1 + 0.03 * smooth_noise(rest * 250, seed) + 0.04 * smooth_noise(rest * 12, seed + 1)
    return base * weave[:, None]


def _skin_base(recipe: AvatarRecipe, rest: Floats) -> Floats:
    seed = derive_seed(recipe.seed, "skin") % 2**31
    base = np.tile(np.asarray(recipe.skin, float), (len(rest), 1))
    blotch = smooth_noise(rest * 45, seed)
    return base * (1 + 0.03 * blotch + 0.025 * smooth_noise(rest * 300, seed + 1))[:, None]


def _head(recipe: AvatarRecipe, body: PosedBody, texels: Texels) -> Floats:
    """Skin with lips, brows, lids and a warmer middle of the face."""
    left, bottom, right, top = HEAD_UV
    uv = np.array([left, bottom]) + texels.uv * [right - left, top - bottom]
    colour = _skin_base(recipe, texels.rest)
    skin = np.asarray(recipe.skin, float)
    eye = body.joint_rest("eye.L")
    local = texels.rest - [0.0, eye[1], eye[2]]
    side = np.abs(local[:, 0])
    front = local[:, 2] > -0.02
    warm = np.exp(-(((side - 0.040) / 0.022) ** 2) - ((local[:, 1] + 0.040) / 0.022) ** 2)
    warm += 0.7 * np.exp(-((side / 0.014) ** 2) - ((local[:, 1] + 0.040) / 0.014) ** 2)
    colour = _mix(colour, skin * [1.0, 0.78, 0.74], 0.5 * warm * front)
    lips = mask_at("lips", uv)
    tint = 0.55 if recipe.phenotype["gender"] > 0.5 else 0.3
    colour = _mix(colour, skin * [0.86, 0.5, 0.5], np.clip(lips * (0.35 + tint), 0, 1))
    lids = mask_at("eyelids", uv)
    colour = _mix(colour, skin * 0.45, np.clip(lids, 0, 1) * 0.45)
    arch = 0.024 + 0.006 * np.exp(-(((side - abs(eye[0]) - 0.008) / 0.016) ** 2))
    brow = (
        _band(local[:, 1] - arch, 0.0035, 0.003) * _band(side - abs(eye[0]), 0.021, 0.008) * front
    )
    hair = np.asarray(recipe.hair.colour, float) * 0.8
    return _mix(colour, hair, 0.85 * brow)


def _skin(recipe: AvatarRecipe, texels: Texels) -> Floats:
    mouth = mask_at("inside-mouth", texels.uv)
    return _mix(_skin_base(recipe, texels.rest), (74, 30, 32), mouth)


def _eyes(recipe: AvatarRecipe, body: PosedBody, texels: Texels) -> Floats:
    """White, iris, pupil, by the distance from the line of sight."""
    centres = np.stack([body.joint_rest("eye.L"), body.joint_rest("eye.R")])
    near = np.where(texels.rest[:, 0] > 0, 0, 1)
    offset = texels.rest - centres[near]
    radius = np.linalg.norm(offset[:, :2], axis=1)
    ahead = offset[:, 2] > 0
    colour = np.tile(np.array([238.0, 234, 230]), (len(radius), 1))
    colour = _mix(colour, recipe.eyes, _band(radius, 0.0062, 0.0008) * ahead)
    return _mix(colour, (14, 12, 12), _band(radius, 0.0028, 0.0006) * ahead)


def _hair(recipe: AvatarRecipe, texels: Texels) -> Floats:
    seed = derive_seed(recipe.seed, "hair") % 2**31
    strands = folds(texels.rest * [200, 14, 200], seed)
    broad = smooth_noise(texels.rest * [50, 8, 50], seed + 2)
    base = np.asarray(recipe.hair.colour, float)
    return base * (0.72 + 0.45 * strands + 0.12 * broad)[:, None]


def _shoes(recipe: AvatarRecipe, body: PosedBody, texels: Texels) -> Floats:
    seed = derive_seed(recipe.seed, "shoes") % 2**31
    ankle = body.joint_rest("foot.L")
    ground = texels.rest[:, 1].min()
    base = np.tile(np.asarray(recipe.shoes.colour, float), (len(texels.rest), 1))
    base *= (1 + 0.02 * smooth_noise(texels.rest * 120, seed))[:, None]
    across = np.abs(np.abs(texels.rest[:, 0]) - ankle[0])
    laces = _band((texels.rest[:, 2] * 100 / 1.6) % 1 - 0.5, 0.2, 0.1) * (across < 0.022)
    laces *= (texels.rest[:, 2] > ankle[2] + 0.045) & (texels.rest[:, 2] < ankle[2] + 0.12)
    base = _mix(base, (225, 225, 222) if sum(recipe.shoes.colour) < 450 else (90, 90, 96), laces)
    return _mix(
        base, recipe.shoes.sole, np.clip((ground + 0.024 - texels.rest[:, 1]) / 0.001, 0, 1)
    )


def painters(recipe: AvatarRecipe, body: PosedBody) -> dict[str, Callable[[Texels], Floats]]:
    """For each layer, the function that gives its texels' colours (N,3), 0 to 255."""
    chest = body.joint_rest("spine01") + np.array([0.0, -0.09, 0.0])
    seed = derive_seed(recipe.seed, "fabric") % 2**31

    def cloth(fabric: Fabric) -> Callable[[Texels], Floats]:
        return lambda texels: fabric_colour(fabric, texels, chest, seed)

    return {
        "head": partial(_head, recipe, body),
        "skin": partial(_skin, recipe),
        "eyes": partial(_eyes, recipe, body),
        "hair": partial(_hair, recipe),
        "top": cloth(recipe.top.fabric),
        "bottom": cloth(recipe.bottom.fabric),
        "shoes": partial(_shoes, recipe, body),
    }
