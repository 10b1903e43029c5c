"""Which faces can be seen from outside: what a scanner would have captured."""

from __future__ import annotations

import numpy as np

from harness.data.avatars.rays import RayScene
from harness.data.avatars.surface import Floats, Ints

__all__ = ["outer_faces"]


def _directions(count: int) -> Floats:
    """Unit vectors (count,3) spread evenly over the sphere (a Fibonacci lattice)."""
    index = np.arange(count) + 0.5
    height = 1 - 2 * index / count
    turn = np.pi * (1 + np.sqrt(5)) * index
    width = np.sqrt(1 - height**2)
    return np.stack([width * np.cos(turn), height, width * np.sin(turn)], axis=1)


def outer_faces(vertices: Floats, faces: Ints, directions: int = 64) -> np.ndarray:
    """Mask (F,) of faces from whose front some ray escapes, and of their neighbours.

    A ray starts 0.2 mm above the face's centre; the face counts as seen if any of ``directions``
    rays of its front half-space meets nothing.
    """
    scene = RayScene(vertices, faces)
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-15)
    start = corners.mean(1) + 2e-4 * normal
    seen = np.zeros(len(faces), bool)
    for direction in _directions(directions):
        ask = np.flatnonzero(~seen & (normal @ direction > 0.05))
        blocked = scene.blocked(start[ask], direction)
        seen[ask[~blocked]] = True
    touched = np.zeros(len(vertices), bool)
    touched[faces[seen].ravel()] = True
    return np.asarray(touched[faces].any(1))
