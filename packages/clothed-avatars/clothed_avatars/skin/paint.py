"""The colour of a texel from where it is on the unposed body: cloth, skin, face, hair, shoes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from clothed_avatars.clothes.wardrobe import Bottom, Colour, Fabric, Hair, Shoes, Top
from clothed_avatars.mesh.noise import folds, smooth_noise
from clothed_avatars.mesh.quads import Floats
from clothed_avatars.people.body import SKIN_VERTICES, AvatarBody, mask_image
from clothed_avatars.skin.fabric import band, cloth_colour, mix
from harness.core.files.hashing import derive_seed

Painter = Callable[[Floats], Floats]
"""Places (N,5), see ``Layer``, to colours (N,3), 0 to 255."""


@dataclass(frozen=True)
class Appearance:
    """What one person looks like.

    seed: seed of grain and pattern; gender: Anny's value, 0 male, 1 female; the others as in the
    person's looks.
    """

    seed: int
    gender: float
    skin: Colour
    eyes: Colour
    hair: Hair
    top: Top
    bottom: Bottom | None
    shoes: Shoes | None


def skin_masks(body: AvatarBody) -> Floats:
    """(V,2) how much of each skin vertex is lip and eyelid, from MakeHuman's masks."""
    uv, uv_quads = body.skin_uv()
    quads = body.quads("skin")
    out = np.zeros((len(body.vertices), 2))
    for k, name in enumerate(("lips", "eyelids")):
        mask = mask_image(name)
        row = np.clip(((1 - uv[:, 1]) * len(mask)).astype(int), 0, len(mask) - 1)
        column = np.clip((uv[:, 0] * mask.shape[1]).astype(int), 0, mask.shape[1] - 1)
        np.maximum.at(out[:, k], quads.ravel(), mask[row, column][uv_quads.ravel()])
    out[SKIN_VERTICES:] = 0
    return out


def _seed(looks: Appearance, use: str) -> int:
    return derive_seed(looks.seed, use) % 2**31


def _skin(looks: Appearance, body: AvatarBody, place: Floats) -> Floats:
    """Skin with lips, lids, brows, warmer cheeks, nose and knuckles."""
    points, lips, lids = place[:, :3], place[:, 3], place[:, 4]
    seed = _seed(looks, "skin")
    skin = np.asarray(looks.skin, float)
    grain = 0.03 * smooth_noise(points * 45, seed) + 0.02 * smooth_noise(points * 260, seed + 1)
    colour = skin * (1 + grain)[:, None]
    eye = body.joint("eye.L")
    side, up, ahead = (points - [0.0, eye[1], eye[2]]).T
    side = np.abs(side)
    front = ahead > -0.02
    warm = np.exp(-(((side - 0.040) / 0.022) ** 2) - ((up + 0.040) / 0.022) ** 2)
    warm += 0.7 * np.exp(-((side / 0.014) ** 2) - ((up + 0.040) / 0.014) ** 2)
    colour = mix(colour, skin * [1.0, 0.78, 0.74], 0.5 * warm * front)
    tint = 0.85 if looks.gender > 0.5 else 0.6
    colour = mix(colour, skin * [0.84, 0.5, 0.5], np.clip(lips * tint, 0, 1))
    colour = mix(colour, skin * 0.42, np.clip(lids, 0, 1) * 0.30)
    arch = 0.024 + 0.006 * np.exp(-(((side - abs(eye[0]) - 0.008) / 0.016) ** 2))
    brow = band(up - arch, 0.0038, 0.003) * band(side - abs(eye[0]), 0.021, 0.008) * front
    return mix(colour, np.asarray(looks.hair.colour, float) * 0.8, 0.85 * brow)


def _eyes(looks: Appearance, body: AvatarBody, place: Floats) -> Floats:
    """White, iris, pupil, by the distance from the line of sight."""
    centres = np.stack([body.joint("eye.L"), body.joint("eye.R")])
    offset = place[:, :3] - centres[np.where(place[:, 0] > 0, 0, 1)]
    radius = np.linalg.norm(offset[:, :2], axis=1)
    colour = np.tile(np.array([236.0, 232, 228]), (len(radius), 1))
    colour = mix(colour, looks.eyes, band(radius, 0.0062, 0.0010) * (offset[:, 2] > 0))
    return mix(colour, (14, 12, 12), band(radius, 0.0028, 0.0008) * (offset[:, 2] > 0))


def _hair(looks: Appearance, place: Floats) -> Floats:
    seed = _seed(looks, "hair")
    strands = folds(place[:, :3] * [220, 30, 60], seed)
    broad = smooth_noise(place[:, :3] * [60, 9, 20], seed + 2)
    base = np.asarray(looks.hair.colour, float)
    return base * (0.72 + 0.45 * strands + 0.12 * broad)[:, None]


def _shoes(shoes: Shoes, body: AvatarBody, place: Floats, seed: int) -> Floats:
    points, sole = place[:, :3], place[:, 3]
    grain = 0.05 * smooth_noise(points * 120, seed)
    colour = np.asarray(shoes.colour, float) * (1 + grain)[:, None]
    ankle = body.joint("foot.L")
    across = np.abs(np.abs(points[:, 0]) - abs(ankle[0]) - 0.01)
    ahead = points[:, 2] - ankle[2]
    laces = (
        band((ahead / 0.016) % 1 - 0.5, 0.2, 0.1)
        * (across < 0.022)
        * (ahead > 0.045)
        * (ahead < 0.12)
    )
    bright = sum(shoes.colour) > 450
    colour = mix(colour, (90, 90, 96) if bright else (225, 225, 222), laces)
    return mix(colour, shoes.sole, (sole > 0.5).astype(float))


def painters(looks: Appearance, body: AvatarBody) -> dict[str, Painter]:
    """For each layer, the function that gives its texels' colours."""

    def cloth(fabric: Fabric, use: str, limb: str = "arm") -> Painter:
        seed = _seed(looks, use)
        return lambda place: cloth_colour(fabric, body, place, limb, seed)

    found: dict[str, Painter] = {
        "skin": lambda place: _skin(looks, body, place),
        "eyes": lambda place: _eyes(looks, body, place),
        "hair": lambda place: _hair(looks, place),
        "top": cloth(looks.top.fabric, "top"),
    }
    if (worn := looks.shoes) is not None:
        found["shoes"] = lambda place: _shoes(worn, body, place, _seed(looks, "shoes"))
    if looks.bottom is not None:
        found["bottom"] = cloth(looks.bottom.fabric, "bottom", "leg")
    if looks.top.inner is not None:
        found["inner"] = cloth(looks.top.inner, "inner")
    return found
