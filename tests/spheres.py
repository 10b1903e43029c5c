"""Spheres of almost equal triangles, for tests that need a closed surface with a closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.core.mesh import Mesh


def icosphere(radius: float, rounds: int = 5, centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """A closed sphere by subdivision of an octahedron."""
    vertices = np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float
    )
    faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4],
                      [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])  # fmt: skip
    for _ in range(rounds):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = vertices[unique].mean(axis=1)
        ab, bc, ca = (len(vertices) + index.reshape(-1, 3)).T
        a, b, c = faces.T
        faces = np.concatenate(
            [np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
        vertices = np.concatenate([vertices, middle / np.linalg.norm(middle, axis=1)[:, None]])
    return Mesh(vertices * radius + np.asarray(centre), faces, source="sphere")
