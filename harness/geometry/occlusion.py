"""What of the surroundings a surface sees: even light with contact shadows, and whether at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster
from harness.geometry.surface import vertex_normals

#: Rays start this far above the surface, metres, so that they do not meet where they start.
_LIFT_M = 1e-3
_BATCH = 1 << 20
#: Directions from which a surface is looked at, and points of it that are tried for its share.
_DIRECTIONS, _SAMPLES = 128, 20_000
#: Where a face is tried: its middle; if it has more than this share of the area, its corners, too.
_PLACES = np.array([[2, 2, 2], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6.0
_LARGE = 1e-5
#: Rays leave a surface from this share of its size above it.
_LEAVE = 2e-5


def vertex_openness(caster: Raycaster, rays: int, seed: int) -> Floats:
    """(V,) share of even light from everywhere that reaches each vertex, 0 to 1.

    The cosine-weighted hemisphere above the surface, sampled by ``rays`` rays that are turned at
    random for each vertex. A convex surface is 1 everywhere.

    Args:
        caster: Rays against the surface.
        rays: Per vertex.
        seed: Seed of the random turns of the rays about each normal.
    """
    mesh = caster.mesh
    normals = vertex_normals(mesh)
    # The disc of Vogel's spiral, lifted: cosine-weighted directions, evenly spread.
    index = np.arange(rays) + 0.5
    radius, turn = np.sqrt(index / rays), index * np.pi * (3.0 - np.sqrt(5.0))
    height = np.sqrt(1.0 - radius**2)
    start = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(normals))
    across, along = _frames(normals)
    open_rays = np.zeros(len(normals))
    step = max(1, _BATCH // rays)
    for first in range(0, len(normals), step):
        rows = slice(first, first + step)
        angle = start[rows, None] + turn
        directions = (
            (radius * np.cos(angle))[..., None] * across[rows, None]
            + (radius * np.sin(angle))[..., None] * along[rows, None]
            + height[:, None] * normals[rows, None]
        )
        origins = mesh.vertices[rows, None] + _LIFT_M * normals[rows, None]
        free = _free(caster, np.broadcast_to(origins, directions.shape), directions)
        open_rays[rows] = free.mean(axis=1)
    return open_rays


def lit_share(caster: Raycaster, points: Floats, normals: Floats, lamp: Floats) -> Floats:
    """(N,) share of a lamp that points (N, 3) on the surface see, world metres.

    Args:
        caster: Rays against the surface.
        points: On it.
        normals: (N, 3) unit, out of it.
        lamp: (L, 3) points of the lamp.
    """
    origins = points + _LIFT_M * normals
    share = np.zeros(len(points))
    for place in lamp:
        share += _free(caster, origins, place - origins)
    return share / len(lamp)


def hidden_faces(mesh: Mesh) -> Mask:
    """(F,) which faces no ray from outside reaches on either side, as a body's under its clothes.

    Rays come from 128 directions: the bottom of a narrow fold may count as hidden.
    """
    caster, is_large = Raycaster(mesh), mesh.face_areas() > _LARGE * mesh.area
    hidden = np.ones(len(mesh.faces), dtype=bool)
    tried = np.arange(len(mesh.faces))
    for weights in _PLACES:
        points = np.einsum("k,fkc->fc", weights, mesh.vertices[mesh.faces[tried]])
        hidden[tried] = _are_hidden(caster, points)
        tried = tried[hidden[tried] & is_large[tried]]
    return hidden


def hidden_share(mesh: Mesh) -> float:
    """The share of a surface's area, to half a percent, that no ray from outside reaches."""
    ends = np.cumsum(mesh.face_areas())
    number = np.arange(_SAMPLES) + 0.5
    faces = np.searchsorted(ends, ends[-1] * number / _SAMPLES)
    # Points that fill the faces evenly, by the additive sequence of the plastic number.
    first, second = np.sqrt(number * 0.7548776662 % 1), number * 0.5698402910 % 1
    weights = np.stack([1 - first, first * (1 - second), first * second], axis=1)
    points = np.einsum("fk,fkc->fc", weights, mesh.vertices[mesh.faces[faces]])
    return float(_are_hidden(Raycaster(mesh), points).mean())


def _are_hidden(caster: Raycaster, points: Floats) -> Mask:
    """(N,) whether points (N, 3) of the surface see the outside in no direction."""
    index = np.arange(_DIRECTIONS) + 0.5
    height, turn = 1.0 - 2.0 * index / _DIRECTIONS, index * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    directions = np.stack([across * np.cos(turn), height, across * np.sin(turn)], axis=1)
    lift = _LEAVE * float(caster.mesh.extent.max())
    left = np.arange(len(points))
    # Far apart one after the other, so that most points are done after a few.
    for direction in directions[index.astype(int) * 37 % _DIRECTIONS]:
        origins = points[left] + lift * direction
        left = left[~_free(caster, origins, np.broadcast_to(direction, origins.shape))]
        if len(left) == 0:
            break
    hidden = np.zeros(len(points), dtype=bool)
    hidden[left] = True
    return hidden


def _free(caster: Raycaster, origins: Floats, directions: Floats) -> NDArray[np.bool_]:
    blocked = caster.blocked(origins.reshape(-1, 3), directions.reshape(-1, 3))
    return ~blocked.reshape(directions.shape[:-1])


def _frames(normals: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (N, 3) each, at right angles to the normals and to each other."""
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    across = np.cross(normals, least)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across /= np.where(length > 0, length, 1.0)
    return across, np.cross(normals, across)
