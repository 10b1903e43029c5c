"""Bodies that the body model cannot give: Anny's, with smooth random bumps and uneven limbs.

A deformation moves the unposed surface along its smoothed normals. Joints stay where they are, and
so do head, hands and feet, which follow shapes that a few millimetres would spoil. The left side is
drawn apart from the right, so that no phenotype, which is symmetric, comes near the result.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.noise import smooth_noise
from clothed_avatars.mesh.quads import Floats, relax, triangles, vertex_normals
from clothed_avatars.people.body import SKIN_VERTICES, AvatarBody
from clothed_avatars.people.landmarks import heights, places, ramp, trunk_axis
from clothed_avatars.people.shape import Deformation
from harness.core.files.hashing import derive_seed

_HELD = ("neck", "head", "eye", "wrist", "finger", "metacarpal", "foot", "toe")
_GIRTHS = ("upperarm", "lowerarm", "upperleg", "lowerleg", "clavicle", "spine", "pelvis")
_GIRTH_SHARE = 0.6
"""How much the uneven limbs count, beside bumps of 1."""
_REACH = 0.22
"""The most that a vertex moves, as a share of its distance from its limb's axis."""
_CLEAR_X_M = 0.02
"""Thighs come no nearer to the middle than this, unless they were."""


def skin_areas(body: AvatarBody, vertices: Floats) -> Floats:
    """The area (SKIN_VERTICES,) in square metres that belongs to each vertex of the skin."""
    faces = triangles(body.quads("skin"))
    corners = vertices[faces]
    doubled = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    areas = np.zeros(SKIN_VERTICES)
    np.add.at(areas, faces.ravel(), np.repeat(doubled / 6, 3))
    return areas


def free_share(body: AvatarBody) -> Floats:
    """How freely each vertex (V,) moves: 0 on head, hands and feet, 1 elsewhere, smooth between."""
    return ramp(body.members(*_HELD), 0.6, 0.0)


def _pattern(body: AvatarBody, deformation: Deformation) -> Floats:
    """The wished movement (V,) along the normals, of any size."""
    bumps = smooth_noise(
        body.vertices / deformation.bump_m, derive_seed(deformation.seed, "bumps") % 2**31
    )
    draw = np.random.default_rng(derive_seed(deformation.seed, "girths"))
    girth = np.array(
        [
            draw.uniform(-1, 1) if name.startswith(_GIRTHS) else 0.0 for name in body.bone_names
        ]
    )  # fmt: skip
    return bumps + _GIRTH_SHARE * np.asarray(body.weights @ girth).ravel()


def _limits(body: AvatarBody) -> Floats:
    """The most (V,) that each vertex may move, metres."""
    where = places(body, body.vertices, body.weights)
    share = np.stack([where.arm, where.leg])
    trunk = np.maximum(1 - share.sum(0), 0)[:, None]
    axis = (
        share[0][:, None] * where.arm_axis
        + share[1][:, None] * where.leg_axis
        + trunk * trunk_axis(body, body.vertices[:, 1])
    )
    return _REACH * np.linalg.norm(body.vertices - axis, axis=1) + 1e-4


def _clear_of_the_middle(body: AvatarBody, moved: Floats) -> Floats:
    """Movements (SKIN_VERTICES,3) after which no thigh crosses the middle."""
    x = body.vertices[:SKIN_VERTICES, 0]
    side = np.where(x > 0, 1.0, -1.0)
    least = np.minimum(np.abs(x), _CLEAR_X_M)
    low = body.vertices[:SKIN_VERTICES, 1] < heights(body).crotch + 0.06
    out = moved.copy()
    inside = low & ((x + moved[:, 0]) * side < least)
    out[inside, 0] = (side * least - x)[inside]
    return out


def _offsets(body: AvatarBody, deformation: Deformation) -> Floats:
    """The movement (V,3) of the unposed body, helper surfaces included."""
    skin = slice(SKIN_VERTICES)
    quads = body.quads("skin")
    free, limit = free_share(body)[skin], _limits(body)[skin]
    areas = skin_areas(body, body.vertices) * free
    wish = _pattern(body, deformation)[skin]
    wish = wish - np.average(wish, weights=areas)
    smooth = relax(body.vertices[skin], quads, 20)
    normals = vertex_normals(smooth, quads)
    size = deformation.rms_m
    moved = np.zeros((SKIN_VERTICES, 3))
    for _ in range(8):
        along = free * limit * np.tanh(size * wish / limit)
        moved = relax(along[:, None] * normals, quads, 6)
        moved = _clear_of_the_middle(body, moved)
        size *= deformation.rms_m / np.sqrt(np.average((moved**2).sum(1), weights=areas))
    near = Nearness(body.vertices[skin], quads)
    _, ids, corners, _ = near.closest(body.vertices[SKIN_VERTICES:])
    follows = np.einsum("nk,nkd->nd", corners, moved[near.faces[ids]])
    return np.concatenate([moved, follows])


def deformed_body(phenotype: Mapping[str, float], deformation: Deformation | None) -> AvatarBody:
    """The body of a phenotype, deformed where a deformation is given.

    Raises:
        MissingPart: Anny is not installed.
    """
    body = AvatarBody(phenotype)
    return body if deformation is None else body.moved(_offsets(body, deformation))
