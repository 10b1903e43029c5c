"""How garments are sewn together, as relief: hems, seams, plackets with buttons, zips, pockets.

Everything is a height over the cloth at a place of the cut, so it follows the cloth into its folds.
Steps are a few millimetres wide, as fine as the mesh can show.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clothed_avatars.mesh.quads import Floats, Ints
from clothed_avatars.people.body import AvatarBody
from clothed_avatars.people.landmarks import Heights, heights, ramp, trunk_axis

_STEP_M = 0.004
_STITCH_M, _STITCH_IN_M = 0.0007, 0.005
"""Height of the ridge along a sewn edge, and how far inside the edge it runs."""
_SEAM_M, _SEAM_WIDTH_M = 0.0013, 0.0035
_BUTTON_M, _BUTTON_RADIUS_M = 0.0022, 0.006
_ZIP_M, _ZIP_WIDTH_M = 0.0025, 0.005
_OPEN_FRONT_M = 0.03


@dataclass(frozen=True)
class Pocket:
    """A patch of cloth: centre and half size (across, up) in metres and its rise.

    Across counts from the middle of the front or back; up from the waist. Both sides of a person
    have it if ``paired``; ``front`` says which side of the trunk.
    """

    centre_m: tuple[float, float]
    half_m: tuple[float, float]
    rise_m: float
    front: bool
    paired: bool


@dataclass(frozen=True)
class Construction:
    """hem_m and hem_rise_m: width of turned edges and their rise; placket_m: width of the front
    strip, 0 if there is none; buttons_m: their distance, 0 without; zipped; seams; pockets.
    """

    hem_m: float
    hem_rise_m: float
    placket_m: float = 0.0
    buttons_m: float = 0.0
    zipped: bool = False
    seams: bool = True
    pockets: tuple[Pocket, ...] = ()


def _draw_pockets(draw: np.random.Generator, kind: str) -> tuple[Pocket, ...]:
    out: list[Pocket] = []
    rise = float(draw.uniform(0.0016, 0.0030))
    if kind == "hooded sweater" and draw.random() < 0.7:
        half = (float(draw.uniform(0.10, 0.13)), float(draw.uniform(0.07, 0.09)))
        out.append(Pocket((0.0, -0.07), half, rise, front=True, paired=False))
    if kind in ("loose shirt", "jacket") and draw.random() < 0.7:
        half = (float(draw.uniform(0.045, 0.06)), float(draw.uniform(0.05, 0.065)))
        paired = bool(draw.random() < 0.5)
        out.append(Pocket((0.085, 0.265), half, rise, front=True, paired=paired))
    if kind in ("jacket", "coat") and draw.random() < 0.8:
        half = (float(draw.uniform(0.055, 0.075)), float(draw.uniform(0.025, 0.085)))
        out.append(Pocket((0.115, -0.10), half, rise + 0.001, front=True, paired=True))
    if kind in ("straight trousers", "wide trousers", "shorts") and draw.random() < 0.8:
        half = (float(draw.uniform(0.055, 0.07)), float(draw.uniform(0.06, 0.075)))
        out.append(Pocket((0.09, -0.15), half, rise, front=False, paired=True))
    return tuple(out)


def draw_construction(kind: str, seed: int) -> Construction:
    """How a garment of a kind is sewn; equal seeds give equal garments."""
    draw = np.random.default_rng(seed)
    closed = kind in ("loose shirt", "coat", "dress") and draw.random() < 0.75
    return Construction(
        hem_m=float(draw.uniform(0.014, 0.036)),
        hem_rise_m=float(draw.uniform(0.0008, 0.0020)),
        placket_m=float(draw.uniform(0.026, 0.038)) if closed else 0.0,
        buttons_m=float(draw.uniform(0.07, 0.11)) if closed else 0.0,
        zipped=kind == "hooded sweater" and bool(draw.random() < 0.45),
        pockets=_draw_pockets(draw, kind),
    )


def _patch(inside: Floats, rise: float) -> Floats:
    """Height of cloth sewn on, from the distance (N,) inside its edge, negative outside."""
    step = ramp(inside, -0.5 * _STEP_M, 0.5 * _STEP_M)
    stitch = np.exp(-(((inside - _STITCH_IN_M) / 0.003) ** 2))
    return rise * step + _STITCH_M * stitch


def _ridge(distance: Floats, height: float, width: float) -> Floats:
    return height * np.exp(-((distance / width) ** 2))


def _pocket(pocket: Pocket, at: Heights, pattern: Floats, facing: Floats) -> Floats:
    across = np.abs(pattern[:, 0]) if pocket.paired else pattern[:, 0]
    side = np.abs(across - pocket.centre_m[0]) - pocket.half_m[0]
    up = np.abs(pattern[:, 1] - at.waist - pocket.centre_m[1]) - pocket.half_m[1]
    height = _patch(-np.maximum(side, up), pocket.rise_m)
    return height * ((facing > 0) if pocket.front else (facing < 0))


def _front(made: Construction, pattern: Floats, facing: Floats) -> Floats:
    """A placket with its buttons, or a zip, down the middle of the front."""
    middle = np.abs(pattern[:, 0])
    out = np.zeros(len(pattern))
    if made.placket_m > 0:
        out += _patch(0.5 * made.placket_m - middle, 0.0016)
    if made.buttons_m > 0:
        row = (pattern[:, 1] / made.buttons_m) % 1 - 0.5
        away = np.hypot(pattern[:, 0], row * made.buttons_m)
        out += _BUTTON_M * ramp(away, _BUTTON_RADIUS_M + 0.002, _BUTTON_RADIUS_M - 0.002)
    if made.zipped:
        out += _ridge(middle, _ZIP_M, _ZIP_WIDTH_M) + _patch(0.014 - middle, 0.0008)
    return out * (facing > _OPEN_FRONT_M)


def _seams(body: AvatarBody, pattern: Floats, part: Ints, is_top: bool) -> Floats:
    """Ridges down the sides of the trunk, under sleeves and on both sides of legs."""
    offset = pattern - trunk_axis(body, pattern[:, 1])
    out = _ridge(offset[:, 2], _SEAM_M, _SEAM_WIDTH_M) * (part == 0)
    for value, side in ((1, "L"), (2, "R")):
        own = part == value
        names = ("upperarm01", "wrist") if is_top else ("upperleg01", "foot")
        start, end = (body.joint(f"{name}.{side}") for name in names)
        axis = (end - start) / np.linalg.norm(end - start)
        local = pattern[own] - start
        local = local - (local @ axis)[:, None] * axis
        # The seam is where the limb is cut by the plane across which it is front and back.
        below = local[:, 1] < 0 if is_top else np.ones(len(local), bool)
        out[own] = _ridge(local[:, 2], _SEAM_M, _SEAM_WIDTH_M) * below
    return out


def relief(
    body: AvatarBody,
    made: Construction,
    pattern: Floats,
    part: Ints,
    to_hem: Floats,
    is_top: bool,
) -> Floats:
    """(V,) heights in metres over the cloth.

    pattern (V,3) and part (V,) as in ``Piece``; to_hem (V,): distance to the nearest border.
    """
    at = heights(body)
    facing = pattern[:, 2] - trunk_axis(body, pattern[:, 1])[:, 2]
    trunk = part == 0
    out = _patch(made.hem_m - to_hem, made.hem_rise_m)
    if made.seams:
        out += _seams(body, pattern, part, is_top)
    if is_top:
        out += _front(made, pattern, facing) * trunk
    else:
        # Fly and waistband; pockets of trousers reach below the crotch, where legs begin.
        out += _patch(0.018 - np.abs(pattern[:, 0] - 0.006), 0.0014) * (
            (facing > 0) & trunk & (pattern[:, 1] > at.crotch + 0.05)
        )
        out += _patch(pattern[:, 1] - at.waist + 0.04, 0.0018)
    for pocket in made.pockets:
        out += _pocket(pocket, at, pattern, facing)
    return out
