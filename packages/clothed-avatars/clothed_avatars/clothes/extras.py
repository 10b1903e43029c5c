"""Shoes, hoods and folded collars: parts that follow one bone or the garment's own weights."""

from __future__ import annotations

import numpy as np

from clothed_avatars.clothes.layer import Layer
from clothed_avatars.mesh.noise import smooth_noise
from clothed_avatars.mesh.quads import Floats, Ints, SparseMatrix, grid
from clothed_avatars.people.body import SKIN_VERTICES, AvatarBody, PosedAvatar, carry
from clothed_avatars.people.landmarks import heights


def _hull(points: Floats) -> tuple[Floats, Ints]:
    """The convex hull as triangles that face outward."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    corners = points[hull.simplices]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fd,fd->f", area, hull.equations[:, :3]) < 0
    faces = hull.simplices.astype(np.int64)
    faces[inward] = faces[inward][:, ::-1]
    return points, faces


def _swell(points: Floats, centre: Floats, margin: float) -> Floats:
    """Points moved away from a centre line by a margin, level."""
    away = points - centre
    away[:, 1] = 0
    return points + margin * away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 0.02)


def _shoe(body: AvatarBody, side: str) -> tuple[tuple[Floats, Ints], tuple[Floats, Ints]]:
    """Upper and sole of one shoe around the unposed foot."""
    skin = body.vertices[:SKIN_VERTICES]
    chosen = [
        k
        for k, n in enumerate(body.bone_names)
        if n.endswith(f".{side}") and n.startswith(("foot", "toe"))
    ]
    share = np.asarray(body.weights[:SKIN_VERTICES, chosen].sum(1)).ravel()
    ankle = body.joint(f"foot.{side}")
    foot = skin[(share > 0.5) & (skin[:, 1] < ankle[1] + 0.02)]
    ground, tip = foot[:, 1].min(), foot[:, 2].max()
    near = (np.abs(skin[:, 1] - ankle[1] - 0.03) < 0.012) & (skin[:, 0] * ankle[0] > 0)
    toes = foot[(foot[:, 2] < tip - 0.012) & (foot[:, 2] > tip - 0.09)].copy()
    toes[:, 1] = ground + 0.048
    upper = _swell(np.concatenate([foot, skin[near], toes]), foot.mean(0), 0.008)
    upper[:, 1] = np.maximum(upper[:, 1] + 0.004, ground + 0.004)
    flat = _swell(foot[foot[:, 1] < ground + 0.03].copy(), foot.mean(0), 0.012)
    slab = np.repeat(flat[None], 2, axis=0)
    slab[0, :, 1], slab[1, :, 1] = ground + 0.012, ground - 0.012
    return _hull(upper), _hull(slab.reshape(-1, 3))


def shoes(body: AvatarBody, posed: PosedAvatar) -> list[Layer]:
    """Both shoes, each an upper and a sole, rigid with the foot."""
    layers = []
    for side in "LR":
        turn = posed.transforms[body.bone_names.index(f"foot.{side}")]
        for k, (points, faces) in enumerate(_shoe(body, side)):
            place = np.concatenate(
                [points, np.full((len(points), 1), k), 0 * points[:, :1]], axis=1
            )
            layers.append(
                Layer("shoes", points @ turn[:3, :3].T + turn[:3, 3], faces, place, solid=True)
            )
    return layers


def collar(body: AvatarBody, posed: PosedAvatar, kind: str, seed: int) -> Layer:
    """A roll of cloth round the neck: a folded collar, or a hood that lies on the back."""
    base = body.joint("neck01") + np.array([0.0, -0.012, 0.0])
    hood = kind == "hood"
    turn = np.radians(np.linspace(-150, 150, 110) if hood else np.linspace(-158, 158, 110))
    back = 0.5 + 0.5 * np.cos(turn)  # 1 at the nape, 0 in front
    line = base + np.stack(
        [
            (0.086 + 0.012 * back) * np.sin(turn),
            (-0.045 + (0.048 if hood else 0.058) * back),
            0.022 - (0.085 + (0.020 if hood else 0.0) * back) * np.cos(turn),
        ],
        axis=1,
    )
    section = np.arange(40) / 40 * 2 * np.pi
    width = (0.016 + 0.026 * back**2) if hood else 0.010 + 0.002 * back
    drop = (0.012 + 0.115 * back**2) if hood else 0.026 + 0.012 * back
    out = np.stack([np.sin(turn), 0 * turn, -np.cos(turn)], axis=1)
    lower = np.minimum(np.sin(section), 0)[None] * drop[:, None]
    rise = np.maximum(np.sin(section), 0)[None] * width[:, None] + lower
    side = np.cos(section)[None] * width[:, None] + (0.35 if hood else 0.55) * -lower
    ring = line[:, None] + side[..., None] * out[:, None] + rise[..., None] * np.array([0.0, 1, 0])
    points, faces = grid(ring, closed=True)
    crumple = (
        0.0055 * smooth_noise(points * 24, seed)
        if hood
        else 0.002 * smooth_noise(points * 30, seed)
    )
    points = points + crumple[:, None] * np.repeat(out, 40, axis=0)
    vertices = carry(points, _neck_weights(body, points), posed.transforms)
    place = np.concatenate(
        [points, np.zeros((len(points), 1)), np.full((len(points), 1), 0.1)], axis=1
    )
    return Layer("top", vertices, faces, place)


def _neck_weights(body: AvatarBody, points: Floats) -> SparseMatrix:
    """The weights of the nearest skin below the neck."""
    from scipy.sparse import coo_matrix
    from scipy.spatial import KDTree

    skin = body.vertices[:SKIN_VERTICES]
    below = np.flatnonzero(skin[:, 1] < heights(body).neck + 0.02)
    _, nearest = KDTree(skin[below]).query(points, k=24)
    weights = body.weights[below[nearest.ravel()]]
    rows = np.repeat(np.arange(len(points)), 24)
    mean = coo_matrix((np.full(len(rows), 1 / 24), (rows, np.arange(len(rows)))))
    return (mean @ weights).tocsr()
