"""Detected landmarks of N views as tensors, and how far bodies are from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from methods.body.models.model import LandmarkTable
from methods.body.photos.detection import Detections
from methods.body.photos.views import View

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
        depth = 1.0 if self.camera.is_orthographic else seen[..., 2:].clamp_min(_NEAREST_M)
        return seen[..., :2] / depth * self._focal.to(points) + self._centre.to(points)

    def to_camera(self, points: Tensor) -> Tensor:
        """(..., 3) points in camera axes (x right, y down, z forward), metres."""
        return self.turn(points) + self._translation.to(points)

    def turn(self, vectors: Tensor) -> Tensor:
        """(..., 3) world directions in camera axes."""
        return vectors @ self._rotation.to(vectors).T


class Projectors:
    """Projects points through some of N cameras at once, in double precision."""

    def __init__(self, cameras: Sequence[Camera]) -> None:
        import torch

        def tensor(values: list[Floats]) -> Tensor:
            return torch.tensor(np.array(values))

        self._rotation = tensor([camera.rotation for camera in cameras])
        self._shift = tensor([camera.world_to_camera[:3, 3] for camera in cameras])
        self._focal = tensor([np.diag(camera.K)[:2] for camera in cameras])
        self._centre = tensor([camera.K[:2, 2] for camera in cameras])
        self._parallel = torch.tensor([camera.is_orthographic for camera in cameras])

    def turned(self, points: Tensor, view: Tensor) -> Tensor:
        """(..., K, 3) world directions in the axes of the cameras (...) that they are given."""
        return points @ self._rotation[view].transpose(-1, -2)

    def pixels(self, turned: Tensor, view: Tensor) -> Tensor:
        """(..., K, 2) pixels of points that ``turned`` gave."""
        import torch

        seen = turned + self._shift[view][..., None, :]
        depth = seen[..., 2:].clamp_min(_NEAREST_M)
        depth = torch.where(self._parallel[view][..., None, None], 1.0, depth)
        focal, centre = (each[view][..., None, :] for each in (self._focal, self._centre))
        return seen[..., :2] / depth * focal + centre


class Evidence:
    """The landmarks that a body has, in N views.

    Args:
        precise: Whether its numbers have double precision.

    Attributes:
        projectors: One per view.
        pixels: (N, K, 2) working pixels.
        points_camera: (N, K, 3) metres about the middle of the hips, camera axes.
        confidence: (N, K), with the table's trust in it.
        side_px: (N,) side of the subject's frame.
        metres_per_px: (N,) at the distance of the subject's place.
    """

    def __init__(
        self,
        views: tuple[View, ...],
        detections: Detections,
        table: LandmarkTable,
        *,
        precise: bool = False,
    ) -> None:
        import torch

        def tensor(values: object) -> Tensor:
            dtype = torch.float64 if precise else torch.float32
            return torch.tensor(np.asarray(values), dtype=dtype)

        self.projectors = [Projector(view.camera) for view in views]
        self.pixels = tensor(detections.pixels[:, table.landmarks])
        self.points_camera = tensor(detections.points_camera[:, table.landmarks])
        self.confidence = tensor(detections.confidence[:, table.landmarks] * table.trust)
        self.side_px = tensor([view.side_px for view in views])
        self.metres_per_px = tensor(
            [v.camera.spread(v.place.distance_m(v.camera)) / v.camera.K[1, 1] for v in views]
        )

    def __len__(self) -> int:
        return len(self.projectors)

    def pixel_error(self, points: Tensor) -> Tensor:
        """(N, K) distance in working pixels of landmarks (N, K, 3) or (1, K, 3), world metres."""
        import torch

        each = points.expand(len(self), -1, -1)
        seen = torch.stack([p(one) for p, one in zip(self.projectors, each, strict=True)])
        return length(seen - self.pixels)


def length(vectors: Tensor) -> Tensor:
    """(...) lengths of vectors (..., D), differentiable also where they are 0."""
    # The root of a tiny number instead of 0 keeps the gradient finite at a perfect match.
    return (vectors.square().sum(-1) + 1e-12).sqrt()
