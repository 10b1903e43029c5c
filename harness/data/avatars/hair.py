"""Hair grown from the scalp: a cap above a hairline, and what hangs or is tied from it."""

from __future__ import annotations

import numpy as np

from harness.core.hashing import derive_seed
from harness.data.avatars.body import PosedBody, mask_at
from harness.data.avatars.garments import finish, hem, push_out
from harness.data.avatars.layer import Layer
from harness.data.avatars.noise import folds, smooth_noise
from harness.data.avatars.recipe import AvatarRecipe
from harness.data.avatars.surface import (
    Floats,
    Patch,
    boundary_edges,
    clip,
    compact,
    smooth,
    subdivide,
    vertex_normals,
)

__all__ = ["HEAD_UV", "eye_centre", "grow_hair", "head_faces", "head_square"]

HEAD_UV = (0.63, 0.14, 1.0, 0.84)
"""Left, bottom, right, top of the head's island in MakeHuman's texture space."""

# Height of the hairline above the eyes (m) by the distance behind the eyes (m), on a head of
# average size; measured by hand on the mean head: forehead, temple, ear, nape.
_HAIRLINE_BEHIND = np.array([-0.03, 0.0, 0.03, 0.055, 0.07, 0.10, 0.12, 0.15, 0.20])
_HAIRLINE_ABOVE = np.array([0.065, 0.060, 0.045, 0.015, -0.005, -0.015, -0.055, -0.075, -0.08])


def head_faces(patch: Patch) -> np.ndarray:
    """Mask (F,) of the skin's faces that lie on the head's texture island."""
    uv = patch.uv[patch.uv_faces]
    left, bottom, right, top = HEAD_UV
    inside = (uv[..., 0] > left) & (uv[..., 0] < right) & (uv[..., 1] > bottom) & (uv[..., 1] < top)
    return inside.all(1)


def eye_centre(body: PosedBody) -> Floats:
    """The point (3,) between the eyes in the rest pose."""
    return (body.joint_rest("eye.L") + body.joint_rest("eye.R")) / 2


def _scale(body: PosedBody) -> float:
    """Size of this head relative to the mean, from the distance between the eyes."""
    gap = float(np.linalg.norm(body.joint_rest("eye.L") - body.joint_rest("eye.R")))
    return gap / 0.0635


def _hair_field(patch: Patch, body: PosedBody, seed: int) -> Floats:
    """Metres (V,) above the hairline; negative on face, ears and neck."""
    local = (patch.vertices - eye_centre(body)) / _scale(body)
    line = np.interp(-local[:, 2], _HAIRLINE_BEHIND, _HAIRLINE_ABOVE)
    ragged = 0.004 * smooth_noise(patch.vertices * 60, seed)
    field = local[:, 1] - line + ragged
    ears = mask_at("ears", patch.uv)
    on_ear = np.zeros(len(patch.vertices))
    np.maximum.at(on_ear, patch.faces.ravel(), ears[patch.uv_faces.ravel()])
    return field - 0.03 * smooth(on_ear[:, None], patch.faces, 1)[:, 0]


def _cap(body: PosedBody, seed: int, thickness: float, drop: float) -> tuple[Patch, Floats]:
    """The scalp pushed outwards, thinner towards the hairline, and its height over the line."""
    skin = body.patch("skin")
    head = subdivide(compact(skin, head_faces(skin)), 1)
    field = _hair_field(head, body, seed) + drop
    scalp = subdivide(clip(head, field), 1)
    field = _hair_field(scalp, body, seed) + drop
    vertices = smooth(scalp.vertices, scalp.faces, 6)
    normals = smooth(vertex_normals(vertices, scalp.faces), scalp.faces, 12)
    rise = np.clip(field / 0.035, 0, 1) ** 0.5
    back = vertices - eye_centre(body)
    strands = folds(np.stack([back[:, 0] * 80, back[:, 1] * 18, back[:, 2] * 70], 1), seed + 3)
    height = 0.003 + rise * (thickness + 0.005 * strands)
    return scalp.moved(vertices + normals * height[:, None]), field


def _curtain(body: PosedBody, seed: int, length: float) -> Patch:
    """A sheet from ear to ear round the back, hanging ``length`` metres below the eyes."""
    from scipy.sparse import csr_matrix

    scale = _scale(body)
    eye = eye_centre(body)
    columns, rows = 72, 36
    turn = np.linspace(-1.0, 1.0, columns) * np.radians(108)
    fall = np.linspace(0, 1, rows)[:, None]
    start = 0.045 * scale
    y = eye[1] + start - fall * (start + length * scale)
    flare = 1 + 0.10 * np.sin(np.pi * np.minimum(fall * 1.4, 1)) + 0.12 * fall
    pleat = np.stack(
        [
            np.tile(turn * 9, (rows, 1)),
            np.repeat(fall * 2.5, columns, 1),
            np.zeros((rows, columns)),
        ],
        -1,
    )
    strands = folds(pleat.reshape(-1, 3), seed + 9).reshape(rows, columns)
    x = 0.092 * scale * np.sin(turn) * flare + 0.010 * strands * np.sin(turn)
    z = (
        eye[2]
        - 0.092 * scale
        - 0.105 * scale * np.cos(turn) * flare
        - 0.010 * strands * np.cos(turn)
    )
    vertices = np.stack([x, np.broadcast_to(y, x.shape), z], -1).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1).reshape(
        -1, 4
    )
    faces = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    uv = np.stack(np.meshgrid(np.linspace(0, 1, columns), np.linspace(1, 0, rows)), -1).reshape(
        -1, 2
    )
    head, chest = (body.bone_names.index(name) for name in ("head", "spine01"))
    share = np.clip((eye[1] - 0.10 * scale - vertices[:, 1]) / 0.12, 0, 0.85)
    weights = np.zeros((len(vertices), len(body.bone_names)))
    weights[:, head], weights[:, chest] = 1 - share, share
    skin, _ = body.groups["skin"]
    for _ in range(2):
        vertices = smooth(push_out(vertices, body.rest, skin, 0.026), faces, 6)
    return _two_sided(Patch(vertices, faces, csr_matrix(weights), uv, faces), 0.012)


def _two_sided(sheet: Patch, thickness: float) -> Patch:
    """A closed slab: the sheet, its reverse ``thickness`` metres behind it, and the rim."""
    from scipy.sparse import csr_matrix, vstack

    normals = vertex_normals(sheet.vertices, sheet.faces)
    count = len(sheet.vertices)
    a, b = boundary_edges(sheet.faces).T
    rim = np.concatenate([np.stack([b, a, a + count], 1), np.stack([b, a + count, b + count], 1)])
    faces = np.concatenate([sheet.faces, sheet.faces[:, ::-1] + count, rim])
    return Patch(
        np.concatenate([sheet.vertices, sheet.vertices - thickness * normals]),
        faces,
        csr_matrix(vstack([sheet.weights, sheet.weights])),
        sheet.uv,
        faces % count,
    )


def _knot(body: PosedBody, seed: int) -> Patch:
    """A bun: a ball at the back of the crown."""
    from scipy.sparse import csr_matrix

    columns, rows = 48, 32
    turn = np.linspace(0, 2 * np.pi, columns)
    tilt = np.linspace(0.02, np.pi - 0.02, rows)[:, None]
    ball = np.stack(
        [np.sin(tilt) * np.cos(turn), np.cos(tilt) + 0 * turn, np.sin(tilt) * np.sin(turn)], -1
    ).reshape(-1, 3)
    twist = ball * 2.2 + np.array([0, 1, 0]) * np.arctan2(ball[:, :1], ball[:, 2:]) * 0.8
    scale = _scale(body)
    radius = (0.036 + 0.006 * folds(twist, seed + 4)) * scale
    centre = eye_centre(body) + np.array([0, 0.055, -0.185]) * scale
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1).reshape(
        -1, 4
    )
    faces = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    uv = np.stack(np.meshgrid(np.linspace(0, 1, columns), np.linspace(1, 0, rows)), -1).reshape(
        -1, 2
    )
    weights = np.zeros((len(ball), len(body.bone_names)))
    weights[:, body.bone_names.index("head")] = 1
    return Patch(centre + ball * radius[:, None], faces, csr_matrix(weights), uv, faces)


def _joined(a: Patch, b: Patch, left: float) -> Patch:
    """Two patches in one, their texture squares side by side: ``a`` gets ``left`` of the width."""
    from scipy.sparse import csr_matrix, vstack

    return Patch(
        np.concatenate([a.vertices, b.vertices]),
        np.concatenate([a.faces, b.faces + len(a.vertices)]),
        csr_matrix(vstack([a.weights, b.weights])),
        np.concatenate([a.uv * [left, 1], b.uv * [0.99 - left, 1] + [left + 0.01, 0]]),
        np.concatenate([a.uv_faces, b.uv_faces + len(a.uv)]),
    )


def head_square(uv: Floats) -> Floats:
    """MakeHuman's texture coordinates (T,2) of the head, stretched to the unit square."""
    left, bottom, right, top = HEAD_UV
    return (uv - [left, bottom]) / [right - left, top - bottom]


def grow_hair(recipe: AvatarRecipe, body: PosedBody) -> Layer:
    """The hair of a recipe as one layer, ``hair``."""
    cut = recipe.hair.cut
    seed = derive_seed(recipe.seed, "hair") % 2**31
    thickness = {"short": 0.012, "bob": 0.020, "long": 0.018, "bun": 0.008}[cut]
    cap, _ = _cap(body, seed, thickness, drop=0.0)
    cap = Patch(cap.vertices, cap.faces, cap.weights, head_square(cap.uv), cap.uv_faces)
    normals = smooth(vertex_normals(cap.vertices, cap.faces), cap.faces, 4)
    cap = hem(cap, normals, np.full(len(cap.vertices), 0.004))
    if cut in ("bob", "long"):
        sheet = _curtain(body, seed, 0.13 if cut == "bob" else 0.24)
        cap = _joined(cap, sheet, 0.5)
    elif cut == "bun":
        cap = _joined(cap, _knot(body, seed), 0.6)
    return finish("hair", cap, body)
