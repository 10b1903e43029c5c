"""Two surfaces become degrees: the angle between their normals at matched points.

Normals are oriented, so that a surface which is inside out is 180 degrees off. They are
interpolated from area-weighted vertex normals (``SurfaceIndex.normals``): the face normals of a
scan carry the noise of its vertices, 7 to 14 degrees of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.core.records import MetricValue
from harness.core.units import Unit
from metrics.sampling import Sampling, sample_mean

__all__ = ["angles_deg", "normal_diagnostics", "normal_error"]

Floats = NDArray[np.float64]


def angles_deg(first: Floats, second: Floats) -> Floats:
    """(N,) angles between (N, 3) vectors, 0 to 180 degrees; 0 is exact, unlike with an arc cosine.

    Vectors of length 0 have no angle; they give 0, so keep them out.
    """
    across = np.linalg.norm(np.cross(first, second), axis=1)
    along = np.einsum("ij,ij->i", first, second)
    return np.degrees(np.arctan2(across, along))


def normal_error(errors_deg: Floats, sampling: Sampling) -> MetricValue:
    """Mean angle between the normals of the predicted samples and of their closest true points.

    In degrees; over the predicted samples alone, as published.

    Source: MExECON, "Normal". The authors' code permutes the barycentric weights of the true
    normal, which changes nothing on fine meshes; here they belong to their own vertices.
    """
    return sample_mean(errors_deg, Unit.degree.value, sampling)


def normal_diagnostics(errors_deg: Floats) -> dict[str, float]:
    """What tells wrong orientation from wrong shape.

    ``median_deg`` and ``share_over_90`` of the oriented angles; ``unoriented_mean_deg`` takes a
    normal and its opposite for the same, as some evaluations do.
    """
    return {
        "median_deg": float(np.median(errors_deg)),
        "share_over_90": float(np.mean(errors_deg > 90)),
        "unoriented_mean_deg": float(np.mean(np.minimum(errors_deg, 180 - errors_deg))),
    }
