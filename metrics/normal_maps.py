"""Two normal maps of one view become degrees: the usual columns of normal estimation.

Every pixel counts the same, whatever surface it shows. Normals are oriented, so that a map that is
turned inside out is 180 degrees off.
"""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError
from harness.core.results import AngularErrors
from metrics.normals import angles_deg

#: Pixels that are less off than this are counted.
THRESHOLDS_DEG = (11.25, 22.5, 30.0)


def angular_error_map(predicted: Floats, truth: Floats, mask: Mask) -> Floats:
    """(H, W) angles between two maps of normals (H, W, 3) in degrees; NaN outside the mask (H, W).

    Raises:
        DataError: maps of different shapes, or a pixel of the mask without a normal.
    """
    shape = (*mask.shape, 3)
    if predicted.shape != shape or truth.shape != shape:
        raise DataError(
            "two normal maps cannot be compared: they have different shapes",
            expected=f"{shape}, as the mask",
            got=f"{predicted.shape} and {truth.shape}",
        )
    for name, normals in (("predicted", predicted), ("true", truth)):
        length = np.linalg.norm(normals[mask], axis=1)
        if not (length > 0).all():
            raise DataError(
                f"the {name} normal map has pixels without a normal inside the mask",
                expected="a finite normal everywhere",
                got=f"{int((~(length > 0)).sum())} of {int(mask.sum())} pixels without",
            )
    errors_deg = np.full(mask.shape, np.nan)
    errors_deg[mask] = angles_deg(predicted[mask], truth[mask])
    return errors_deg


def angular_errors(errors_deg: Floats) -> AngularErrors:
    """The summary of the errors (N,) of some pixels, degrees."""
    if not len(errors_deg):
        return AngularErrors(None, None, None, None, None, 0)
    low, middle, high = (float(np.mean(errors_deg < limit)) for limit in THRESHOLDS_DEG)
    return AngularErrors(
        mean_deg=float(np.mean(errors_deg)),
        median_deg=float(np.median(errors_deg)),
        share_below_11_25=low,
        share_below_22_5=middle,
        share_below_30=high,
        n=len(errors_deg),
    )
