"""What the rays of a camera meet first and last: the near and the far side of a mesh.

ECON's front and back maps share one pixel grid. Under full perspective the back is therefore not
what a second camera sees, but the last surface along the front camera's own rays.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.raycast import Hits, Raycaster

__all__ = ["Side", "SidedRaycaster"]

Side = Literal["near", "far"]

#: The rays to the far side start this much behind the mesh, metres.
_BEHIND_M = 0.1


class SidedRaycaster:
    """Answers rays against one mesh (world metres) from both of their ends."""

    def __init__(self, mesh: Mesh) -> None:
        self._near = Raycaster(mesh)

    def cast(self, camera: Camera, side: Side) -> Hits:
        """The first or the last hit of every pixel's central ray.

        Depth (H, W) is in metres along the camera's optical axis for both sides.
        """
        return self._near.cast(camera) if side == "near" else self._cast_far(camera)

    def normals(self, camera: Camera, side: Side) -> Floats:
        """(H, W, 3) unit smooth normals, x right, y up, z towards the viewer; 0 where no hit.

        They point out of the mesh: towards the viewer on the near side, away on the far side.
        """
        return self.normals_at(self.cast(camera, side), camera)

    def normals_at(self, hits: Hits, camera: Camera) -> Floats:
        """As ``normals``, of rays that were cast already."""
        return self._near.normals_at(hits, camera, "camera")

    def _cast_far(self, camera: Camera) -> Hits:
        shape = (camera.height, camera.width)
        depth = np.full(shape, np.nan)
        face = np.full(shape, -1, dtype=np.int32)
        barycentric = np.zeros((*shape, 3), dtype=np.float32)
        hits = Hits(depth=depth, face=face, barycentric=barycentric)
        window = self._near.window(camera)
        if window.empty:
            return hits
        rows, columns = window.slices
        directions = camera.ray_directions(camera.pixel_centres()[rows, columns].reshape(-1, 2))
        vertices = self._near.mesh.vertices
        end_m = float(camera.project(vertices)[1].max()) + _BEHIND_M
        answer = self._near.answer(camera.position + end_m * directions, -directions)
        t = answer["t_hit"].numpy().reshape(window.height, window.width)
        met = np.isfinite(t)
        # Directions have unit depth, so the ray's parameter counts depth from its far end.
        depth[rows, columns][met] = end_m - t[met]
        face[rows, columns][met] = _image(answer["primitive_ids"], t)[met].astype(np.int32)
        # Open3D's (u, v) weigh the second and third corner.
        second_third = _image(answer["primitive_uvs"], t)[met]
        weights = np.column_stack([1.0 - second_third.sum(axis=1), second_third])
        barycentric[rows, columns][met] = weights
        return hits


def _image(answer: Any, like: NDArray[Any]) -> NDArray[Any]:
    values = answer.numpy()
    return values.reshape(*like.shape, *values.shape[1:])
