"""Where a reconstruction fails: the errors of each labelled region of the true surface.

The means over a whole person hide a missing hand. Here the same points as behind the means are
told apart by the label of the true face that they lie on, or that is nearest to them.
"""

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.mesh import Mesh
from harness.core.records import RegionErrors
from harness.core.truth import FaceRegions
from metrics.score import PointErrors

#: True surface farther than this from the prediction is missing from it; predicted surface farther
#: than this from the truth is a bulge.
FAR_MM = 50.0


def region_errors(
    predicted: PointErrors, truth: PointErrors, surface: Mesh, regions: FaceRegions
) -> dict[str, RegionErrors]:
    """The errors of every region that has an area, by name.

    Weighted by their points, the regions' means add up to the mean over the whole surface.

    Args:
        predicted: Errors of the points on the prediction.
        truth: Errors of the points on the true surface.
        surface: The true surface.
        regions: The region of each of its faces.
    """
    areas = np.linalg.norm(surface.face_normals(), axis=1)
    shares = np.bincount(regions.of_face, areas, len(regions.names)) / areas.sum()
    near, on = regions.of_face[predicted.closest_faces], regions.of_face[truth.faces]
    return {
        name: _errors(predicted, near == index, truth, on == index, float(shares[index]))
        for index, name in enumerate(regions.names)
        if shares[index] > 0
    }


def _errors(
    predicted: PointErrors,
    near: Mask,
    truth: PointErrors,
    on: Mask,
    area_share: float,
) -> RegionErrors:
    angles_deg = predicted.normal_errors_deg[near]
    there_mm, back_mm = predicted.distances_mm[near], truth.distances_mm[on]
    return RegionErrors(
        area_share=area_share,
        accuracy_mm=_mean(there_mm),
        completeness_mm=_mean(back_mm),
        normal_error_deg=_mean(angles_deg[np.isfinite(angles_deg)]),
        missing_share=_mean(back_mm > FAR_MM),
        bulge_share=_mean(there_mm > FAR_MM),
        n_predicted=len(there_mm),
        n_truth=len(back_mm),
    )


def _mean(values: Floats | Mask) -> float | None:
    return float(values.mean()) if len(values) else None
