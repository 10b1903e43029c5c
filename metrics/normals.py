"""Two surfaces become degrees: the angle between their normals at matched points.

Normals are oriented, so that a surface which is inside out is 180 degrees off. They are
interpolated from area-weighted vertex normals (``SurfaceIndex.smooth_normals``): the face normals
of a scan carry the noise of its vertices, 7 to 14 degrees of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError
from harness.core.results import MetricValue, NormalSummary
from harness.core.units import Unit
from harness.geometry.surface import SurfaceIndex, SurfacePoints
from metrics.sampling import Sampling, sample_mean

NormalWeights = Literal["barycentric", "permuted"]


def angles_deg(first: Floats, second: Floats) -> Floats:
    """(N,) angles between (N, 3) vectors, 0 to 180 degrees; 0 is exact, unlike with an arc cosine.

    Vectors of length 0 have no angle; they give 0, so keep them out.
    """
    across = np.linalg.norm(np.cross(first, second), axis=1)
    along = np.einsum("ij,ij->i", first, second)
    return np.degrees(np.arctan2(across, along))


def weighted(where: SurfacePoints, weights: NormalWeights) -> SurfacePoints:
    """The points with the weights that a protocol gives to the vertices of their faces.

    ``permuted`` is a mistake of the published evaluator that its numbers contain: Open3D's (u, v)
    weigh the 2nd and the 3rd vertex, and the evaluator gives u to the 1st, v to the 2nd and
    1 - u - v to the 3rd.
    """
    if weights == "barycentric":
        return where
    return replace(where, barycentric=where.barycentric[:, [1, 2, 0]])


def normals_at(
    surface: SurfaceIndex, where: SurfacePoints, cancelled: Literal["face", "left-out"]
) -> Floats:
    """(N, 3) unit normals; where they cancel, those of the faces, or NaN if these are left out."""
    return surface.normals(where) if cancelled == "face" else surface.smooth_normals(where)


def compared(errors_deg: Floats) -> Floats:
    """The errors of the points that have one; a point without a normal is NaN.

    Raises:
        DataError: no point has one.
    """
    known = errors_deg[np.isfinite(errors_deg)]
    if len(known) == 0:
        raise DataError(
            "there is no normal error",
            expected="smooth normals on both meshes",
            got="normals that cancel each other everywhere, as on a sheet without thickness",
        )
    return known


def normal_error(errors_deg: Floats, sampling: Sampling) -> MetricValue:
    """Mean angle between the normals of the predicted samples and of their closest true points.

    In degrees; over the predicted samples alone, as published, and of these over those that have
    normals to compare.

    Source: MExECON, "Normal".

    Raises:
        DataError: no sample has.
    """
    return sample_mean(compared(errors_deg), Unit.degree.value, sampling)


def normal_summary(errors_deg: Floats, back_errors_deg: Floats) -> NormalSummary:
    """What tells wrong orientation from wrong shape.

    Args:
        errors_deg: (N,) oriented angles at the predicted points that have one.
        back_errors_deg: (M,) the same at the true points; NaN where a point has none.
    """
    back_known = back_errors_deg[np.isfinite(back_errors_deg)]
    return NormalSummary(
        median_deg=float(np.median(errors_deg)),
        share_over_90=float(np.mean(errors_deg > 90)),
        unoriented_mean_deg=float(np.mean(np.minimum(errors_deg, 180 - errors_deg))),
        truth_to_predicted_mean_deg=float(back_known.mean()) if len(back_known) else None,
    )
