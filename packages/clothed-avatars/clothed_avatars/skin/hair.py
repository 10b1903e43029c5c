"""Hair as surfaces with locks: a cap on the scalp, and what hangs or is tied from it."""

from __future__ import annotations

import numpy as np

from clothed_avatars.clothes.layer import Layer
from clothed_avatars.clothes.wardrobe import Hair
from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.noise import smooth_noise
from clothed_avatars.mesh.quads import (
    Floats,
    Ints,
    compact,
    grid,
    refine,
    vertex_normals,
)
from clothed_avatars.people.body import AvatarBody, PosedAvatar, carry
from clothed_avatars.people.landmarks import HeadPlace, falling_weights, head_place

# The hairline: elevation over the head's centre (degrees) at compass directions from the front.
_HAIRLINE_DEG = ([0, 25, 50, 75, 90, 105, 125, 180], [44, 42, 32, 14, 14, 2, -22, -38])
_CROWN = np.array([0.0, 0.8, -0.6])
_SOFT_DEG = 14.0
_SHARE = {"short": 1.0, "curly": 1.15, "long": 0.9, "bun": 0.55, "ponytail": 0.55}


def _above_hairline(points: Floats, centre: Floats) -> tuple[Floats, Floats]:
    """Degrees above the hairline, and elevation over the head's centre."""
    x, y, z = (points - centre).T
    elevation = np.degrees(np.arctan2(y, np.hypot(x, z)))
    return elevation - np.interp(np.degrees(np.abs(np.arctan2(x, z))), *_HAIRLINE_DEG), elevation


def _locks(points: Floats, centre: Floats, style: str, seed: int) -> Floats:
    """Relief in metres: locks that run from the crown, or curls."""
    offset = points - centre
    across = np.cross(_CROWN, [1.0, 0, 0])
    angle = np.arctan2(offset @ across, offset[:, 0])
    bend = smooth_noise(points * 22, seed)
    broad = 0.004 * smooth_noise(points * 26, seed + 1)
    if style == "curly":
        return (
            broad
            + 0.006 * smooth_noise(points * 75, seed + 2)
            + 0.003 * smooth_noise(points * 150, seed)
        )
    fine = 0.0016 * np.sin(angle * 58 + 5 * bend) + 0.0022 * np.sin(angle * 21 + 4 * bend)
    return broad + fine


def _cap(body: AvatarBody, head: HeadPlace, hair: Hair, seed: int) -> tuple[Floats, Ints]:
    quads = body.quads("skin")
    centres = body.vertices[quads].mean(1)
    above, _ = _above_hairline(centres, head.centre)
    on_head = body.members("head")[quads].mean(1) > 0.3
    chosen = (above > -12) & on_head & (centres[:, 1] > body.joint("neck02")[1])
    used, quads = compact(quads[chosen])
    points, quads, _ = refine(body.vertices[used], quads, 2)
    above, elevation = _above_hairline(points, head.centre)
    away = points - head.centre
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    normal = vertex_normals(points, quads) + away
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    grown = np.sqrt(np.clip((above + 2) / _SOFT_DEG, 0, 1))
    volume = hair.thickness * _SHARE[hair.style] * (1 + 0.5 * np.clip(elevation / 90, 0, 1))
    relief = _locks(points, head.centre, hair.style, seed)
    depth = np.where(
        above > -2, grown * (volume + relief * min(1.0, _SHARE[hair.style] + 0.1)), -0.004
    )
    return points + normal * depth[:, None], quads


def _bun(head: HeadPlace) -> tuple[Floats, Ints]:
    polar, turn = np.meshgrid(
        np.linspace(0, np.pi, 34), np.arange(64) / 64 * 2 * np.pi, indexing="ij"
    )
    swirl = 1 + 0.035 * np.sin(9 * turn + 7 * polar)
    ball = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), -np.cos(polar)], -1
    )
    ball *= swirl[..., None] * np.array([0.045, 0.042, 0.040])
    return grid(ball + np.array([0, head.top - 0.035, head.back - 0.012]), closed=True)


def _ponytail(head: HeadPlace) -> tuple[Floats, Ints]:
    s = np.linspace(0, 1, 60)
    line = np.stack(
        [
            0.006 * np.sin(5 * s),
            head.top - 0.055 + 0.03 * np.sin(np.pi * np.minimum(2.2 * s, 1)) - 0.30 * s**1.25,
            head.back - 0.002 - 0.055 * np.sin(np.pi * np.clip(1.1 * s, 0, 1) ** 0.7),
        ],
        axis=1,
    )
    radius = 0.010 + 0.021 * np.sin(np.pi * np.clip(s, 0.03, 1) ** 0.75) + 0.004 * (s < 0.06)
    along = np.gradient(line, axis=0)
    up = np.cross(along / np.linalg.norm(along, axis=1, keepdims=True), [1.0, 0, 0])
    turn = np.arange(48) / 48 * 2 * np.pi
    width = radius[:, None] * (1 + 0.10 * np.sin(11 * turn + 6 * s[:, None]))
    side = np.cos(turn)[None, :, None] * np.array([1.0, 0, 0])
    ring = width[..., None] * (side + np.sin(turn)[None, :, None] * up[:, None])
    return grid(line[:, None] + ring, closed=True)


def _fall(
    head: HeadPlace, skin: Nearness, seed: int, inset: float, length: float = 0.30
) -> tuple[Floats, Ints]:
    """Hair that falls from the head over the back, ``inset`` under its outer surface."""
    angle = np.radians(np.linspace(96.0, 264.0, 150)).astype(float)
    out = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    rows: list[Floats] = []
    for k in range(int(length / 0.005) + 30):
        share = k / (length / 0.005 + 30)
        bend = smooth_noise(
            np.stack([3 * angle, 0 * angle + 4 * share, 0 * angle], 1).astype(float), seed
        )
        wave = 0.003 * np.sin(40 * angle + 4 * bend) + 0.006 * np.sin(13 * angle + 3 * share)
        base = np.array([0.082 + 0.012 * share, 0.0, 0.098 - 0.01 * share])
        row = head.centre + [0, 0.045 - 0.005 * k, -0.004] + out * base
        row = row + out * (wave * (0.4 + 0.6 * share))[:, None]
        for _ in range(4):
            height, _ = skin.height(row)
            row[:, 2] -= 1.3 * np.clip(0.012 + 0.034 * share - inset - height, 0, 0.05)
        if rows:
            row[:, [0, 2]] = 0.6 * row[:, [0, 2]] + 0.4 * rows[-1][:, [0, 2]]
        rows.append(row)
    return grid(np.stack(rows), closed=False)


def grow_hair(body: AvatarBody, posed: PosedAvatar, hair: Hair, seed: int) -> list[Layer]:
    """The hair of a person as layers named ``hair``: what sits on the head moves with it."""
    head = head_place(body)
    parts = [_cap(body, head, hair, seed)]
    if hair.style == "bun":
        parts.append(_bun(head))
    if hair.style == "ponytail":
        parts.append(_ponytail(head))
    loose: list[tuple[Floats, Ints]] = []
    if hair.style == "long":
        skin = Nearness(body.vertices, body.quads("skin"))
        loose = [_fall(head, skin, seed, inset) for inset in (0.0, 0.011)]
    turn = posed.transforms[body.bone_names.index("head")]
    layers = [
        _layer(points, points @ turn[:3, :3].T + turn[:3, 3], faces) for points, faces in parts
    ]
    for points, faces in loose:
        weights = falling_weights(body, points)
        layers.append(_layer(points, carry(points, weights, posed.transforms), faces))
    return layers


def _layer(place: Floats, vertices: Floats, faces: Ints) -> Layer:
    return Layer("hair", vertices, faces, np.pad(place, ((0, 0), (0, 2))))
