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
        side_px: (N,) side of the subject's frame.
        metres_per_px: (N,) at the distance of the subject's place.
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
        self.side_px = tensor([view.side_px for view in views])
        self.metres_per_px = tensor(
            [view.place.distance_m(view.camera) / view.camera.K[1, 1] for view in views]
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
