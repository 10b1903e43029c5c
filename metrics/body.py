"""How well a fitted body agrees with the pictures, and with the true body where that is known.

The losses are those of the paper's first table, each per image and without unit: the square frame
around the subject that they refer to has an area of 1 and a half side of 1, whatever the picture's
size. Errors are in millimetres and without any alignment.

Source: MExECON, equations of the silhouette, normal and landmark loss and table "JMBO ablation".
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError
from harness.core.units import MM_PER_METRE

#: Weights of the normal and the landmark loss in the total; the silhouette's is 1.
TOTAL_WEIGHTS = {"normal": 0.2, "landmark": 0.1}


def silhouette_loss(predicted: Mask, truth: Mask, side_px: float) -> float:
    """Area where two silhouettes (H, W) differ, as a share of the subject's frame."""
    _check_same_shape(predicted, truth)
    return float((predicted != truth).sum()) / side_px**2


def silhouette_iou(predicted: Mask, truth: Mask) -> float:
    """Intersection over union of two silhouettes (H, W); 1 where both are empty."""
    _check_same_shape(predicted, truth)
    union = float((predicted | truth).sum())
    return float((predicted & truth).sum()) / union if union else 1.0


def normal_loss(predicted: Floats, truth: Floats, side_px: float) -> float:
    """Mean absolute difference of two normal maps (H, W, 3) where both have one.

    The mean is over the three components and over the subject's whole frame, where pixels without
    both normals count as 0, as in ECON.
    """
    _check_same_shape(predicted, truth)
    known = predicted.any(axis=2) & truth.any(axis=2)
    return float(np.abs(predicted - truth)[known].mean(axis=1).sum()) / side_px**2


def landmark_loss(projected: Floats, detected: Floats, confidence: Floats, side_px: float) -> float:
    """Confidence-weighted mean distance of landmarks (K, 2), in half sides of the frame.

    NaN where nothing was detected: such an image has no landmark loss.
    """
    _check_same_shape(projected, detected)
    if not confidence.sum() > 0:
        return float("nan")
    distances_px = np.linalg.norm(projected - detected, axis=1)
    return float((confidence * distances_px).sum() / confidence.sum()) * 2.0 / side_px


def total_loss(silhouette: float, normal: float, landmark: float) -> float:
    """The weighted sum of the three losses, as in the paper's table."""
    return silhouette + TOTAL_WEIGHTS["normal"] * normal + TOTAL_WEIGHTS["landmark"] * landmark


def joint_error_mm(predicted: Floats, truth: Floats) -> Floats:
    """(J,) distances of joints (J, 3), metres, to the true ones, in mm; nothing is aligned."""
    return _distances_mm(predicted, truth)


def vertex_error_mm(predicted: Floats, truth: Floats) -> Floats:
    """(V,) distances of vertices (V, 3), metres, to the same vertices of the true body, in mm."""
    return _distances_mm(predicted, truth)


def _distances_mm(predicted: Floats, truth: Floats) -> Floats:
    _check_same_shape(predicted, truth)
    return np.linalg.norm(predicted - truth, axis=1) * MM_PER_METRE


def _check_same_shape(predicted: NDArray[Any], truth: NDArray[Any]) -> None:
    if predicted.shape != truth.shape:
        raise DataError(
            "two bodies or pictures cannot be compared: they have different shapes",
            expected=str(truth.shape),
            got=str(predicted.shape),
        )
