"""Detected landmarks of N views as tensors, and how far bodies are from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from methods.body.fit.projection import Projector
from methods.body.models.model import LandmarkTable
from methods.body.photos.detection import Detections
from methods.body.photos.views import View

if TYPE_CHECKING:
    from torch import Tensor


class Evidence:
    """The landmarks that a body has, in N views.

    Attributes:
        projectors: One per view.
        pixels: (N, K, 2) working pixels.
        confidence: (N, K), with the table's trust in it.
        points_camera: (N, K, 3) metres about the middle of the hips, camera axes.
        side_px: (N,) side of the subject's frame.
        metres_per_px: (N,) at the distance of the subject's place.
        centre: (3,) the middle of the subject's place, world metres.
        depth_is_known: Whether the views tell how far away the subject is.
    """

    def __init__(
        self, views: tuple[View, ...], detections: Detections, table: LandmarkTable
    ) -> None:
        import torch

        def tensor(values: object) -> Tensor:
            return torch.tensor(np.asarray(values), dtype=torch.float32)

        self.projectors = [Projector(view.camera) for view in views]
        self.pixels = tensor(detections.pixels[:, table.landmarks])
        self.confidence = tensor(detections.confidence[:, table.landmarks] * table.trust)
        self.points_camera = tensor(detections.points_camera[:, table.landmarks])
        self.side_px = tensor([view.side_px for view in views])
        self.metres_per_px = tensor(
            [view.place.distance_m(view.camera) / view.camera.K[1, 1] for view in views]
        )
        self.centre = tensor(views[0].place.centre)
        self.depth_is_known = views[0].place.depth_is_known
        self.forward = tensor([view.camera.forward for view in views])
        self._hips = [int(np.flatnonzero(table.landmarks == hip)[0]) for hip in (23, 24)]

    def __len__(self) -> int:
        return len(self.projectors)

    def pixel_error(self, points: Tensor) -> Tensor:
        """(N, K) distance in working pixels of landmarks (N, K, 3) or (1, K, 3), world metres."""
        import torch

        each = points.expand(len(self), -1, -1)
        seen = torch.stack([p(one) for p, one in zip(self.projectors, each, strict=True)])
        return length(seen - self.pixels)

    def space_error(self, points: Tensor) -> Tensor:
        """(N, K) metres between landmarks (N, K, 3) and the detector's own, hips on hips.

        Where the views do not tell how far away the subject is, the detector's landmarks are made
        as large as these first: its metres are a mean person's, and would pass for a measurement.
        """
        import torch

        turned = torch.stack([p.turn(one) for p, one in zip(self.projectors, points, strict=True)])
        about_hips = turned - turned[:, self._hips].mean(1, keepdim=True)
        if self.depth_is_known:
            return length(about_hips - self.points_camera)
        return length(about_hips - self._as_large_as(about_hips) * self.points_camera)

    def _as_large_as(self, about_hips: Tensor) -> Tensor:
        """(N, 1, 1) what the detector's landmarks are multiplied by to fit others (N, K, 3)."""
        weights = self.confidence[..., None]
        own = (weights * self.points_camera**2).sum((1, 2), keepdim=True)
        both = (weights * self.points_camera * about_hips).sum((1, 2), keepdim=True)
        return (both / own).detach()


def length(vectors: Tensor) -> Tensor:
    """(...) lengths of vectors (..., D), differentiable also where they are 0."""
    # The root of a tiny number instead of 0 keeps the gradient finite at a perfect match.
    return (vectors.square().sum(-1) + 1e-12).sqrt()
