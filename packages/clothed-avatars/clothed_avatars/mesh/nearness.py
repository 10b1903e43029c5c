"""How far points are from a surface, on which side, and how to keep them off it."""

from __future__ import annotations

from typing import Any

import numpy as np

from clothed_avatars.mesh.quads import Floats, Ints, relax, triangles

_CHUNK = 1_000_000


class Nearness:
    """Closest points of one triangle surface; the side is that of the closest face's normal."""

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        import open3d as o3d

        self._tensor: Any = o3d.core.Tensor
        # One thread: the same points whatever else the machine does, and no fight over two cores.
        self._scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        self.faces = triangles(faces)
        self._scene.add_triangles(
            self._tensor(vertices.astype(np.float32)), self._tensor(self.faces.astype(np.uint32))
        )

    def closest(self, points: Floats) -> tuple[Floats, Ints, Floats, Floats]:
        """(N,3) closest points, (N,) their triangles, (N,3) corner weights there, (N,3) normals."""
        parts = []
        for start in range(0, len(points), _CHUNK):
            chunk = np.ascontiguousarray(points[start : start + _CHUNK], np.float32)
            found = self._scene.compute_closest_points(self._tensor(chunk))
            second, third = found["primitive_uvs"].numpy().astype(float).T
            parts.append(
                (
                    found["points"].numpy().astype(float),
                    found["primitive_ids"].numpy().astype(np.int64),
                    np.stack([1 - second - third, second, third], axis=1),
                    found["primitive_normals"].numpy().astype(float),
                )
            )
        points_, ids, weights, normals = (
            np.concatenate(column) for column in zip(*parts, strict=True)
        )
        return (
            points_,
            ids,
            weights,
            normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12),
        )

    def distance(self, points: Floats) -> Floats:
        """(N,) unsigned distances in metres."""
        parts = [
            self._scene.compute_distance(
                self._tensor(np.ascontiguousarray(points[i : i + _CHUNK], np.float32))
            ).numpy()
            for i in range(0, len(points), _CHUNK)
        ]
        return np.concatenate(parts)

    def height(self, points: Floats) -> tuple[Floats, Floats]:
        """(N,) signed distances, positive outside, and (N,3) unit directions outward."""
        nearest, _, _, normals = self.closest(points)
        offset = points - nearest
        length = np.linalg.norm(offset, axis=1)
        side = np.where(np.einsum("nd,nd->n", offset, normals) < 0, -1.0, 1.0)
        away = offset * (side / np.maximum(length, 1e-12))[:, None]
        return side * length, np.where((length > 1e-4)[:, None], away, normals)


def keep_off(
    vertices: Floats, faces: Ints, surface: Nearness, gap: float, rounds: int = 12
) -> Floats:
    """Vertices (V,3) of a cloth moved out until they are ``gap`` metres off the surface.

    Relaxing in between spreads the push over the neighbourhood; the last rounds only push.
    """
    for step in range(rounds):
        height, outward = surface.height(vertices)
        vertices = vertices + np.maximum(gap - height, 0.0)[:, None] * outward
        if step < rounds - 3:
            vertices = relax(vertices, faces, 1, 0.3)
    return vertices


def pushed_off(vertices: Floats, surface: Nearness, gap: float, rounds: int = 2) -> Floats:
    """Vertices (V,3) moved out until they are ``gap`` metres off the surface, and nothing else."""
    for _ in range(rounds):
        height, outward = surface.height(vertices)
        vertices = vertices + np.maximum(gap - height, 0.0)[:, None] * outward
    return vertices
