"""Clothes cut from MakeHuman's helper surfaces: pattern, ease, folds, hem.

Each garment is made in the rest pose, where limbs stand free of each other, and then carried into
the pose with the body's own bones.
"""

from __future__ import annotations

import numpy as np

from harness.core.hashing import derive_seed
from harness.core.mesh import Mesh
from harness.data.avatars.anatomy import LimbPlace, limb_places, pattern_places, torso_axis
from harness.data.avatars.body import PosedBody, skin_vertices
from harness.data.avatars.layer import Layer
from harness.data.avatars.noise import folds, smooth_noise
from harness.data.avatars.recipe import AvatarRecipe
from harness.data.avatars.surface import (
    Floats,
    Ints,
    Patch,
    boundary_edges,
    clip,
    smooth,
    subdivide,
    vertex_normals,
)
from harness.data.avatars.wardrobe import Bottom, Shoes, Top
from harness.geometry.surface import SurfaceIndex

__all__ = ["dress", "finish", "hem", "push_out"]


def _ramp(values: Floats, low: float, high: float) -> Floats:
    share = np.clip((values - low) / (high - low), 0, 1)
    return share * share * (3 - 2 * share)


def push_out(points: Floats, surface: Floats, faces: Ints, gap: float) -> Floats:
    """Points (V,3), those nearer than ``gap`` metres to the surface or inside it moved outside."""
    index = SurfaceIndex(Mesh(surface, faces, source="the surface underneath"))
    found, distance = index.closest(points)
    normal = index.normals(found)
    height = np.einsum("vi,vi->v", points - found.points, normal)
    lack = np.maximum(gap - height, 0)
    # Only what is near: a far point "under" a surface belongs to another part of the body.
    lack[distance > 0.04] = 0
    return points + lack[:, None] * normal


def hem(patch: Patch, normals: Floats, depth: Floats) -> Patch:
    """The patch with its open borders turned in towards the body by ``depth`` (V,) metres."""
    from scipy.sparse import csr_matrix, vstack

    owner = np.zeros(len(patch.uv), np.int64)
    owner[patch.uv_faces.ravel()] = patch.faces.ravel()
    border = boundary_edges(patch.faces)
    ring, index = np.unique(border, return_inverse=True)
    index = index.reshape(-1, 2) + len(patch.vertices)
    inner = patch.vertices[ring] - normals[ring] * depth[ring, None]
    a, b = border.T
    c, d = index.T
    strip = np.concatenate([np.stack([b, a, c], 1), np.stack([b, c, d], 1)])
    corner = np.zeros(len(patch.vertices), np.int64)
    corner[owner] = np.arange(len(patch.uv))
    outer = np.concatenate([np.arange(len(patch.vertices)), ring])
    return Patch(
        np.concatenate([patch.vertices, inner]),
        np.concatenate([patch.faces, strip]),
        csr_matrix(vstack([patch.weights, patch.weights[ring]])),
        patch.uv,
        np.concatenate([patch.uv_faces, corner[outer[strip]]]),
    )


def _widen(
    patch: Patch, places: dict[str, LimbPlace], kind: str, radius: Floats, member: float
) -> Floats:
    """Vertices with each limb of a kind made at least ``radius`` (V,) wide."""
    vertices = patch.vertices.copy()
    for name, place in places.items():
        if not name.startswith(kind):
            continue
        width = np.linalg.norm(place.radial, axis=1)
        lack = np.maximum(radius - width, 0) * _ramp(place.member, member, 0.98)
        vertices += place.radial / np.maximum(width, 1e-6)[:, None] * lack[:, None]
    return vertices


def _curtain(vertices: Floats, faces: Ints, body: PosedBody, top_y: float, share: Floats) -> Floats:
    """Vertices of the trunk, hanging from the widest place above them instead of clinging."""
    from scipy.ndimage import gaussian_filter1d, map_coordinates

    axis = torso_axis(vertices, body)
    radial = vertices - axis
    width = np.maximum(np.linalg.norm(radial, axis=1), 1e-6)
    turn = (np.arctan2(radial[:, 0], radial[:, 2]) / (2 * np.pi)) % 1 * 48
    angle = turn.astype(int) % 48
    step = 0.015
    depth = (top_y - vertices[:, 1]) / step
    level = np.floor(depth).astype(int)
    use = (level >= 0) & (share > 0.95)
    if not use.any():
        return vertices
    grid = np.zeros((48, level.max() + 1))
    np.maximum.at(grid, (angle[use], level[use]), width[use])
    for row in range(1, grid.shape[1]):
        grid[:, row] = np.maximum(grid[:, row], grid[:, row - 1] - 0.12 * step)
    grid = gaussian_filter1d(gaussian_filter1d(grid, 2.0, axis=0, mode="wrap"), 1.5, axis=1)
    grid = np.concatenate([grid[-1:], grid, grid[:1]])  # one turn of overlap to read across 0
    target = map_coordinates(grid, [turn + 0.5, depth - 0.5], order=1, mode="nearest")
    lack = np.maximum(target - width, 0) * _ramp(depth, -3.0, 3.0) * share
    lack = smooth(lack[:, None], faces, 12)[:, 0]
    return vertices + radial / width[:, None] * lack[:, None]


def _fold_height(patch: Patch, body: PosedBody, places: dict[str, LimbPlace], seed: int) -> Floats:
    """Height (V,) of the folds in metres: rings at joints, drapes on the trunk."""
    v = patch.vertices
    axis = torso_axis(v, body)
    turn = np.arctan2(v[:, 0], v[:, 2] - axis[:, 2])
    around = np.stack([np.sin(turn), np.cos(turn)], 1)
    slant = v[:, 1] + 0.35 * np.abs(v[:, 0])
    trunk = np.stack([slant * 9, around[:, 0] * 2.6, around[:, 1] * 2.6], 1)
    height = 0.009 * folds(trunk, seed)
    for index, place in enumerate(places.values()):
        width = np.maximum(np.linalg.norm(place.radial, axis=1, keepdims=True), 1e-6)
        ring = np.concatenate([place.length[:, None] * 15, place.radial / width * 0.9], 1)[
            :, [0, 1, 2]
        ]
        along = place.along
        joint = np.exp(-(((along - 1) / 0.28) ** 2)) + 0.8 * np.exp(-(((along - 1.9) / 0.22) ** 2))
        groin = 0.7 * np.exp(-(((along - 0.12) / 0.2) ** 2))
        amplitude = 0.0035 + 0.0065 * joint + 0.005 * groin
        share = _ramp(place.member, 0.3, 0.9)
        rings = amplitude * folds(ring + 3.1 * index, seed + 11 * (index + 1))
        height = height * (1 - share) + rings * share
    return height


def _no_arms(places: dict[str, LimbPlace]) -> Floats:
    return np.clip(1 - places["arm.L"].member - places["arm.R"].member, 0, 1)


def _sleeve_field(places: dict[str, LimbPlace], end: float) -> Floats:
    """Positive above the sleeve's end (in ``along`` units)."""
    reach = np.maximum(
        places["arm.L"].along * places["arm.L"].member,
        places["arm.R"].along * places["arm.R"].member,
    )
    return end - reach


def _neck_field(patch: Patch, body: PosedBody, radius: float) -> Floats:
    """Metres (V,) from the neckline, positive below it: a round opening about the neck's axis."""
    offset = patch.vertices - body.joint_rest("neck01") - [0.0, 0.0, 0.016]
    # Depth counts less in front, so that the opening is a bowl that hangs lower there.
    depth = np.maximum(-offset[:, 1], 0) * (2.5 - 1.75 * _ramp(offset[:, 2], -0.06, 0.02))
    return np.linalg.norm([offset[:, 0], offset[:, 2], depth], axis=0) - radius


def _hip_height(body: PosedBody) -> float:
    return float(body.joint_rest("upperleg01.L")[1])


def _leg_reach(places: dict[str, LimbPlace]) -> Floats:
    return np.maximum(
        places["leg.L"].along * (places["leg.L"].member > 0.05),
        places["leg.R"].along * (places["leg.R"].member > 0.05),
    )


def _suit(body: PosedBody) -> Patch:
    """The full-body helper surface, fine enough for folds."""
    return subdivide(body.patch("tights"), 2)


def _tops(patch: Patch, top: Top, body: PosedBody, seed: int, under: Patch) -> Patch:
    places = limb_places(patch, body)
    free = _no_arms(places)
    hem_field = (patch.vertices[:, 1] - (_hip_height(body) - top.hem)) * free + (1 - free)
    wave = 0.004 * smooth_noise(patch.vertices * 9, seed + 5)
    cut = np.minimum.reduce(
        [_sleeve_field(places, top.sleeve), hem_field + wave, _neck_field(patch, body, top.neck)]
    )
    patch = clip(patch, cut)
    places = limb_places(patch, body)
    normals = vertex_normals(patch.vertices, patch.faces)
    normals = smooth(normals, patch.faces, 10)
    # Cloth lies on the shoulders and stands off below them.
    lies = 1 - 0.8 * _ramp(normals[:, 1], 0.3, 0.9)
    stands = _ramp(_neck_field(patch, body, top.neck), 0.0, 0.06) * lies
    eased = patch.moved(
        smooth(patch.vertices, patch.faces, 14)
        + normals * (0.004 + stands * (top.ease - 0.004))[:, None]
    )
    armpit = float(body.joint_rest("upperarm01.L")[1]) - 0.10
    hung = _curtain(eased.vertices, eased.faces, body, armpit, _no_arms(places) ** 2)
    eased = eased.moved(hung)
    if top.sleeve_radius:
        radius = np.full(len(hung), top.sleeve_radius)
        eased = eased.moved(_widen(eased, limb_places(eased, body), "arm", radius, 0.5))
    pushed = push_out(eased.vertices, under.vertices, under.faces, 0.006) - eased.vertices
    # Spread, so that the waistband does not print through.
    clear = eased.vertices + smooth(pushed, eased.faces, 12)
    clear = push_out(clear, under.vertices, under.faces, 0.003)
    height = _fold_height(eased, body, places, seed) * (0.15 + 0.85 * stands)
    return _finish_cloth(eased.moved(clear), body, height)


def _finish_cloth(patch: Patch, body: PosedBody, fold_height: Floats, gap: float = 0.005) -> Patch:
    """The cloth clear of the skin, folded outwards, hemmed."""
    skin, _ = body.groups["skin"]
    clear = push_out(patch.vertices, body.rest, skin, gap)
    normals = smooth(vertex_normals(clear, patch.faces), patch.faces, 12)
    folded = patch.moved(clear + normals * fold_height[:, None])
    return hem(folded, normals, np.full(len(clear), 0.006) + fold_height)


def _trousers(patch: Patch, bottom: Bottom, body: PosedBody, seed: int) -> Patch:
    places = limb_places(patch, body)
    free = _no_arms(places)
    waist = (_hip_height(body) + 0.10 - patch.vertices[:, 1]) * free - (1 - free)
    patch = clip(patch, np.minimum(waist * 4, bottom.length - _leg_reach(places)))
    places = limb_places(patch, body)
    normals = smooth(vertex_normals(patch.vertices, patch.faces), patch.faces, 10)
    eased = patch.moved(smooth(patch.vertices, patch.faces, 14) + normals * bottom.ease)
    if bottom.width:
        reach = _leg_reach(places)
        radius = bottom.width * np.clip(reach / 0.9, 0, 1) ** 0.5
        eased = eased.moved(_widen(eased, limb_places(eased, body), "leg", radius, 0.5))
    height = _fold_height(eased, body, places, seed)
    return _finish_cloth(eased, body, height)


def _skirt(bottom: Bottom, body: PosedBody, seed: int) -> Patch:
    patch = subdivide(body.patch("skirt"), 2)
    hip = _hip_height(body)
    knee = float(body.joint_rest("lowerleg01.L")[1])
    ankle = float(body.joint_rest("foot.L")[1])
    hem_y = np.interp(bottom.length, [0, 1, 2], [hip, knee, ankle])
    v = patch.vertices
    patch = clip(patch, np.minimum(v[:, 1] - hem_y, hip + 0.10 - v[:, 1]))
    v = patch.vertices
    axis = torso_axis(v, body)
    radial = (v - axis) * [1, 0, 1]
    width = np.linalg.norm(radial, axis=1, keepdims=True)
    fall = _ramp(hip + 0.06 - v[:, 1], 0.0, float(hip + 0.06 - hem_y))
    turn = np.arctan2(radial[:, 0], radial[:, 2])
    pleat = np.stack([np.sin(turn) * 3.4, v[:, 1] * 1.2, np.cos(turn) * 3.4], 1)
    height = (0.002 + 0.016 * fall) * folds(pleat, seed)
    out = radial / np.maximum(width, 1e-6)
    eased = patch.moved(v + out * (bottom.ease + bottom.flare * fall)[:, None])
    return _finish_cloth(eased, body, height, gap=0.012)


def _shoes(patch: Patch, shoes: Shoes, body: PosedBody) -> Patch:
    places = limb_places(patch, body)
    ankle = float(body.joint_rest("foot.L")[1])
    leg = np.maximum(places["leg.L"].member, places["leg.R"].member)
    patch = clip(
        patch, np.where(leg > 0.5, ankle + 0.02 + shoes.height - patch.vertices[:, 1], -1.0)
    )
    ground = float(patch.vertices[:, 1].min())
    rounded = smooth(patch.vertices, patch.faces, 5)
    normals = smooth(vertex_normals(rounded, patch.faces), patch.faces, 3)
    low = _ramp(ankle - rounded[:, 1], 0.0, 0.05)
    v = rounded + normals * (0.004 + 0.008 * low)[:, None]
    skin, _ = body.groups["skin"]
    v = push_out(v, body.rest, skin, 0.004)
    # A sole: what is low is stretched down to one flat plane.
    v[:, 1] = (
        np.interp(v[:, 1] - ground, [-0.1, 0.008, 0.045, 1], [-0.018, -0.018, 0.045, 1]) + ground
    )
    shoe = patch.moved(v)
    return hem(shoe, normals, np.full(len(v), 0.010))


def finish(name: str, patch: Patch, body: PosedBody) -> Layer:
    """A patch carried into the pose."""
    posed = skin_vertices(patch.vertices, patch.weights, body.transforms)
    places = pattern_places(patch, body)
    return Layer(name, posed, patch.vertices, places, patch.faces, patch.uv, patch.uv_faces)


def dress(recipe: AvatarRecipe, body: PosedBody) -> list[Layer]:
    """The clothes of a recipe on a body: layers ``top``, ``bottom`` and ``shoes``."""
    suit = _suit(body)
    seed = [derive_seed(recipe.seed, part) % 2**31 for part in ("top", "bottom")]
    if recipe.bottom.kind == "skirt":
        bottom = _skirt(recipe.bottom, body, seed[1])
    else:
        bottom = _trousers(suit, recipe.bottom, body, seed[1])
    top = _tops(suit, recipe.top, body, seed[0], bottom)
    parts = [
        ("top", top),
        ("bottom", bottom),
        ("shoes", _shoes(subdivide(body.patch("tights"), 1), recipe.shoes, body)),
    ]
    return [finish(name, patch, body) for name, patch in parts]
