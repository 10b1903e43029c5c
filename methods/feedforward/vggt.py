"""VGGT: depth from its depth head, cameras from its camera head, and nothing given but photos.

Source: Wang et al., "VGGT: Visual geometry grounded transformer", CVPR 2025. Its authors say that
depth unprojected with the estimated cameras is usually more accurate than the head for points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from methods.feedforward.memory import NetworkSize
from methods.feedforward.poses import decoded_cameras
from methods.feedforward.source import NetworkSettings, Prepared, fitted_photos, required
from methods.foreign.exchange import Answer
from methods.points.sources import SourceRequest, ViewDepth

_PATCH = 14


@dataclass(frozen=True, slots=True)
class Vggt:
    """How VGGT is asked; see ``Dialect``."""

    name: str = "vggt"
    title: str = "VGGT"
    alignments: tuple[str, ...] = ("sim3_cameras", "known_cameras", "oracle_icp")
    worker_module: ClassVar[str] = "methods.feedforward.workers.vggt.worker"

    def check(self, settings: NetworkSettings) -> None:
        """It takes notice of all."""

    def size(self, weights_bytes: int) -> NetworkSize:
        """As published: 24 blocks that hand on 2048 numbers for each patch."""
        return NetworkSize(weights_bytes, width=2048, blocks=24, patch=_PATCH)

    def prepared(self, request: SourceRequest, settings: NetworkSettings) -> Prepared:
        """The photos, fitted."""
        return fitted_photos(request, settings, _PATCH)

    def arrays(self, prepared: Prepared) -> Mapping[str, NDArray[Any]]:  # noqa: ARG002
        """Only pictures."""
        return {}

    def views(self, answer: Answer, prepared: Prepared) -> tuple[ViewDepth, ...]:
        """Depth with the decoded cameras."""
        arrays = required(answer, "pose_enc", "depth", "confidence")
        cameras = decoded_cameras(arrays["pose_enc"], prepared.frames[0].size)
        return tuple(
            ViewDepth(frame, camera, depth, confidence)
            for frame, camera, depth, confidence in zip(
                prepared.frames,
                cameras,
                arrays["depth"].astype(np.float64),
                arrays["confidence"].astype(np.float64),
                strict=True,
            )
        )
