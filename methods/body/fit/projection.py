"""A camera's projection in torch: ``Camera.project`` with gradients."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.core.cameras.camera import Camera

if TYPE_CHECKING:
    from torch import Tensor

#: Points nearer than this are projected as if they were this far, so that nothing divides by zero.
_NEAREST_M = 0.05


class Projector:
    """Projects world points through one camera, differentiably."""

    def __init__(self, camera: Camera) -> None:
        import torch

        self.camera = camera
        self._rotation = torch.from_numpy(camera.rotation.copy())
        self._translation = torch.from_numpy(camera.world_to_camera[:3, 3].copy())
        self._focal = torch.tensor([camera.K[0, 0], camera.K[1, 1]], dtype=torch.float64)
        self._centre = torch.tensor([camera.K[0, 2], camera.K[1, 2]], dtype=torch.float64)

    def __call__(self, points: Tensor) -> Tensor:
        """(..., 2) pixels of world points (..., 3), metres."""
        seen = self.to_camera(points)
        depth = seen[..., 2:].clamp_min(_NEAREST_M)
        return seen[..., :2] / depth * self._focal.to(points) + self._centre.to(points)

    def to_camera(self, points: Tensor) -> Tensor:
        """(..., 3) points in camera axes (x right, y down, z forward), metres."""
        return self.turn(points) + self._translation.to(points)

    def turn(self, vectors: Tensor) -> Tensor:
        """(..., 3) world directions in camera axes."""
        return vectors @ self._rotation.to(vectors).T
