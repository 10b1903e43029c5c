"""Rays against plain triangle arrays; the one place here that talks to Open3D."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.data.avatars.surface import Floats, Ints

__all__ = ["RayScene"]


class RayScene:
    """Triangles prepared for ray casting."""

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        import open3d as o3d

        self._tensor: Any = o3d.core.Tensor
        self._scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            self._tensor(vertices.astype(np.float32)), self._tensor(faces.astype(np.uint32))
        )

    def _rays(self, origins: Floats, direction: Floats) -> Any:
        rays = np.empty((len(origins), 6), np.float32)
        rays[:, :3], rays[:, 3:] = origins, direction
        return self._tensor(rays)

    def blocked(self, origins: Floats, direction: Floats) -> NDArray[np.bool_]:
        """Whether anything lies in one direction (3,) from each origin (N,3)."""
        return self._scene.test_occlusions(self._rays(origins, direction)).numpy()

    def first_hits(
        self, origins: Floats, direction: Floats
    ) -> tuple[NDArray[np.bool_], Ints, Floats]:
        """Which rays (N,) hit; for those that do, the face (H,) and barycentric weights (H,3)."""
        found = self._scene.cast_rays(self._rays(origins, direction))
        hit = np.isfinite(found["t_hit"].numpy())
        second, third = found["primitive_uvs"].numpy()[hit].astype(float).T
        weights = np.stack([1 - second - third, second, third], 1)
        return hit, found["primitive_ids"].numpy()[hit].astype(np.int64), weights
