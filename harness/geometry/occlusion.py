"""How much of the surroundings each point of a surface sees: even light with contact shadows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.geometry.raycast import Raycaster
from harness.geometry.surface import vertex_normals

#: Rays start this far above the surface, metres, so that they do not meet where they start.
_LIFT_M = 1e-3
_BATCH = 1 << 20


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
