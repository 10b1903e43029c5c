"""Clothes cut from the helper surface that covers the body like tights: pattern and ease.

A cut piece hangs around the unposed body, nowhere inside it, as the cloth solver needs to start.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from clothed_avatars.clothes.panels import hang
from clothed_avatars.clothes.wardrobe import Bottom, Fabric, Top
from clothed_avatars.mesh.nearness import Nearness, keep_off
from clothed_avatars.mesh.quads import (
    Floats,
    Ints,
    SparseMatrix,
    border_loops,
    compact,
    refine,
    relax,
    relax_border,
    vertex_normals,
)
from clothed_avatars.people.body import AvatarBody
from clothed_avatars.people.landmarks import Heights, Places, heights, places, ramp, trunk_axis
from harness.core.errors import DataError
from harness.geometry.coinciding import pieces_of

_LEVELS = 1
_EASE_M = 0.010
_CLEAR_M = 0.006


@dataclass(frozen=True)
class Piece:
    """One garment around the unposed body.

    vertices (V,3) m; quads (Q,4); weights (V,B); pin (V,): 1 where it is held by the body; pattern
    (V,3): where its cloth was cut, for its print; part (V,): 0 trunk, 1 left, 2 right limb.
    """

    name: str
    fabric: Fabric
    vertices: Floats
    quads: Ints
    weights: SparseMatrix
    pin: Floats
    pattern: Floats
    part: Ints


@dataclass
class _Sheet:
    vertices: Floats
    quads: Ints
    weights: SparseMatrix
    pattern: Floats
    places: Places
    pin: Floats
    opening: np.ndarray

    def keep(self, mask: np.ndarray) -> None:
        """Keep the faces all of whose vertices are in the mask: their largest connected piece."""
        quads = self.quads[mask[self.quads].all(1)]
        if len(quads) == 0:
            raise DataError(
                "a garment's cut leaves no cloth", hint="Check the lengths in its recipe"
            )
        pieces = pieces_of(quads, len(self.vertices))
        used, self.quads = compact(quads[pieces.of_face == pieces.face_counts.argmax()])
        self.vertices, self.weights = self.vertices[used], self.weights[used]
        self.pattern, self.pin = self.pattern[used], self.pin[used]
        self.opening = self.opening[used]
        self.places = Places(*(getattr(self.places, f.name)[used] for f in fields(Places)))

    def loop_at(self, top: bool) -> Ints:
        """The highest or lowest border that goes around the body."""
        around = [
            loop for loop in border_loops(self.quads) if abs(self.vertices[loop, 0].mean()) < 0.08
        ]
        return (max if top else min)(around, key=lambda loop: self.vertices[loop, 1].mean())

    def fit(self, skin: Nearness, ease: float, rounds: int = 6) -> None:
        """Bridge hollows, as a tailor does, and clear the body."""
        self.vertices = keep_off(self.vertices, self.quads, skin, ease)
        self.vertices = relax(self.vertices, self.quads, rounds)
        self.vertices = keep_off(self.vertices, self.quads, skin, _CLEAR_M)


def _tights(body: AvatarBody) -> _Sheet:
    used, quads = compact(body.quads("tights"))
    weights = body.weights[used]
    vertices, quads, dense = refine(body.vertices[used], quads, _LEVELS, weights.toarray())
    from scipy.sparse import csr_matrix

    weights = csr_matrix(dense)
    where = places(body, vertices, weights)
    nowhere = np.zeros(len(vertices))
    return _Sheet(vertices, quads, weights, vertices.copy(), where, nowhere, nowhere > 0)


def _level(vertices: Floats, loop: Ints, height: float) -> None:
    vertices[loop, 1] = height


def _neck_mask(body: AvatarBody, at: Heights, top: Top, vertices: Floats) -> np.ndarray:
    """Vertices below the neckline."""
    base = body.joint("neck01")
    forward = vertices[:, 2] - base[2]
    line = at.neck + top.neck - top.scoop * ramp(forward, -0.02, 0.10)
    line = line - top.vee * ramp(np.abs(vertices[:, 0]), 0.12, 0.0) * (forward > 0)
    beside = np.hypot(vertices[:, 0], forward) > 0.125
    return (vertices[:, 1] < line) | beside


def _ease_top(body: AvatarBody, at: Heights, top: Top, sheet: _Sheet) -> Floats:
    """The sheet's vertices with the cut's widths."""
    p, where = sheet.vertices, sheet.places
    chest = 1 + (top.chest - 1) * ramp(p[:, 1], at.shoulder + 0.02, at.shoulder - 0.14)
    chest *= 1 + (top.waist - 1) * np.exp(-(((p[:, 1] - at.waist) / 0.09) ** 2))
    axis = trunk_axis(body, p[:, 1])
    around = np.stack([chest, np.ones_like(chest), chest], axis=1)
    trunk = axis + (p - axis) * around
    widths = [1, 1 + (top.sleeve_ease - 1) * 0.7, top.sleeve_ease, top.cuff]
    width = np.interp(where.down_arm, [0, 0.15, 0.5, 1], widths)
    sleeve = where.arm_axis + (p - where.arm_axis) * width[:, None]
    share = ramp(where.arm, 0.1, 0.9)[:, None]
    return trunk * (1 - share) + sleeve * share + _EASE_M * vertex_normals(p, sheet.quads)


def _straighten_cuffs(body: AvatarBody, sheet: _Sheet, sleeve: float) -> None:
    """Each sleeve's end made flat across the arm."""
    bones = ("lowerarm01", "wrist") if sleeve > 0.5 else ("upperarm01", "lowerarm01")
    for loop in border_loops(sheet.quads):
        centre = sheet.vertices[loop].mean(0)
        if abs(centre[0]) < 0.15:
            continue
        side = "L" if centre[0] > 0 else "R"
        axis = body.joint(f"{bones[1]}.{side}") - body.joint(f"{bones[0]}.{side}")
        axis /= np.linalg.norm(axis)
        off = (sheet.vertices[loop] - centre) @ axis
        sheet.vertices[loop] -= off[:, None] * axis


def _front_strip(body: AvatarBody, sheet: _Sheet, width: float) -> np.ndarray:
    """Vertices within a strip down the front."""
    forward = sheet.vertices[:, 2] - trunk_axis(body, sheet.vertices[:, 1])[:, 2]
    return (np.abs(sheet.vertices[:, 0]) < width / 2) & (forward > 0) & (sheet.places.arm < 0.3)


def _smooth_neckline(sheet: _Sheet) -> Ints:
    """The neckline's vertices, after its steps along the cloth's rows were evened out."""
    neck = sheet.loop_at(top=True)
    for _ in range(8):
        line = sheet.vertices[neck]
        sheet.vertices[neck] = 0.5 * line + 0.25 * (np.roll(line, 1, 0) + np.roll(line, -1, 0))
    return neck


def cut_top(body: AvatarBody, top: Top, skin: Nearness, name: str = "top") -> Piece:
    """A garment that hangs from the shoulders."""
    at = heights(body)
    sheet = _tights(body)
    where = sheet.places
    hem = at.hip - top.hem
    cut = max(hem, at.crotch + 0.045)
    in_sleeve = ~((where.arm > 0.3) & (where.down_arm > top.sleeve))
    in_trunk = (sheet.vertices[:, 1] > cut) | (where.arm > 0.5)
    mask = in_sleeve & in_trunk & _neck_mask(body, at, top, sheet.vertices)
    mask &= ~((where.leg > 0.5) & (sheet.vertices[:, 1] < at.crotch + 0.03))
    sheet.vertices = _ease_top(body, at, top, sheet)
    sheet.keep(mask)
    sheet.fit(skin, _EASE_M * 0.8)
    lower = sheet.loop_at(top=False)
    _level(sheet.vertices, lower, cut)
    _straighten_cuffs(body, sheet, top.sleeve)
    neck = _smooth_neckline(sheet)
    sheet.vertices = relax(sheet.vertices, sheet.quads, 2, 0.4)
    sheet.pin[neck] = 1.0
    sheet.opening = _front_strip(body, sheet, top.opening)
    if hem < cut - 0.01:
        _lengthen(body, sheet, lower, hem, top.flare, top.ripple)
    if sheet.opening.any():
        sheet.keep(~sheet.opening)
        sheet.vertices = relax_border(sheet.vertices, sheet.quads, 4)
    limb = np.where(sheet.pattern[:, 0] > 0, 1, 2)
    return Piece(
        name,
        top.fabric,
        sheet.vertices,
        sheet.quads,
        sheet.weights,
        sheet.pin,
        sheet.pattern,
        np.where(sheet.places.arm > 0.5, limb, 0),
    )


def _lengthen(
    body: AvatarBody, sheet: _Sheet, loop: Ints, hem: float, flare: float, ripple: float
) -> None:
    """Hang a tube from a border down to the height ``hem``."""
    from scipy.sparse import vstack

    tube = hang(body, sheet.vertices[loop], hem, flare, ripple)
    rows = len(tube.vertices) // len(loop)
    start = len(sheet.vertices)
    names = np.concatenate([loop, start + np.arange(len(tube.vertices))])
    sheet.vertices = np.concatenate([sheet.vertices, tube.vertices])
    # Borders run against their faces; a tube's faces must run along them to face outward.
    sheet.quads = np.concatenate([sheet.quads, names[tube.quads]])
    sheet.weights = vstack([sheet.weights] + [sheet.weights[loop]] * rows).tocsr()
    sheet.pattern = np.concatenate([sheet.pattern, tube.pattern])
    sheet.pin = np.concatenate([sheet.pin, np.zeros(len(tube.vertices))])
    sheet.opening = np.concatenate([sheet.opening, np.tile(sheet.opening[loop], rows)])
    sheet.places = Places(
        *(
            np.concatenate([value, np.zeros((len(tube.vertices), *value.shape[1:]))])
            for value in (getattr(sheet.places, f.name) for f in fields(Places))
        )
    )


def _ease_trousers(body: AvatarBody, at: Heights, bottom: Bottom, sheet: _Sheet) -> Floats:
    p, where = sheet.vertices, sheet.places
    widths = [1, 1 + (bottom.knee - 1) * 0.4, bottom.knee, bottom.cuff]
    k = np.interp(where.down_leg, [0, 0.12, 0.5, 1], widths)
    leg = where.leg_axis + (p - where.leg_axis) * np.stack([k, np.ones_like(k), k], axis=1)
    k = 1 + (bottom.hip - 1) * ramp(p[:, 1], at.waist, at.waist - 0.1)
    axis = trunk_axis(body, p[:, 1])
    hips = axis + (p - axis) * np.stack([k, np.ones_like(k), k], axis=1)
    share = ramp(p[:, 1], at.crotch + 0.02, at.crotch - 0.12)[:, None]
    eased = hips * (1 - share) + leg * share + _EASE_M * vertex_normals(p, sheet.quads)
    # Wide legs must not cross in the middle.
    side = np.where(p[:, 0] > 0, 1.0, -1.0)
    crossing = (p[:, 1] < at.crotch - 0.03) & (eased[:, 0] * side < 0.006)
    eased[crossing, 0] = 0.006 * side[crossing]
    return eased


def cut_bottom(body: AvatarBody, bottom: Bottom, skin: Nearness, name: str = "bottom") -> Piece:
    """A garment that hangs from the waist."""
    at = heights(body)
    sheet = _tights(body)
    mask = (sheet.vertices[:, 1] < at.waist) & (sheet.places.arm < 0.1)
    mask &= np.abs(sheet.vertices[:, 0]) < 0.36
    cut = at.crotch + 0.10
    if bottom.skirt:
        mask &= sheet.vertices[:, 1] > cut
        sheet.vertices = sheet.vertices + _EASE_M * 0.8 * vertex_normals(
            sheet.vertices, sheet.quads
        )
    else:
        mask &= sheet.places.down_leg < bottom.length
        sheet.vertices = _ease_trousers(body, at, bottom, sheet)
    sheet.keep(mask)
    sheet.fit(skin, _EASE_M * 0.7, rounds=10 if bottom.skirt else 6)
    waist = sheet.loop_at(top=True)
    for loop in border_loops(sheet.quads):
        _level(sheet.vertices, loop, float(sheet.vertices[loop, 1].mean()))
    _level(sheet.vertices, waist, at.waist)
    if bottom.skirt:
        lower = sheet.loop_at(top=False)
        _level(sheet.vertices, lower, cut)
        _lengthen(body, sheet, lower, at.hip - bottom.length, bottom.flare, bottom.ripple)
    limb = np.where(sheet.pattern[:, 0] > 0, 1, 2)
    below = (sheet.pattern[:, 1] < at.crotch + 0.02) & (not bottom.skirt)
    return Piece(
        name,
        bottom.fabric,
        sheet.vertices,
        sheet.quads,
        sheet.weights,
        (sheet.pattern[:, 1] > at.waist - 0.03).astype(float),
        sheet.pattern,
        np.where(below, limb, 0),
    )
