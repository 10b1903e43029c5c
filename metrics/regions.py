"""Where a reconstruction fails: the errors of each labelled region of the true surface.

The means over a whole person hide a missing hand. Here the same points as behind the means are
told apart by the label of the true face that they lie on, or that is nearest to them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from harness.core.mesh import Mesh
from metrics.score import PointErrors

__all__ = ["BODY_REGIONS", "FAR_MM", "FaceRegions", "RegionErrors", "region_errors"]

#: True surface farther than this from the prediction is missing from it; predicted surface farther
#: than this from the truth is a bulge.
FAR_MM = 50.0
#: Labels of the person; what has any other label is worn.
BODY_REGIONS = frozenset({"head", "eyes", "hair", "torso", "arms", "hands", "legs", "feet"})


@dataclass(frozen=True, slots=True, eq=False)
class FaceRegions:
    """Which region each face of a true surface belongs to.

    Attributes:
        names: Of the regions.
        of_face: (F,) indices of ``names``.
    """

    names: tuple[str, ...]
    of_face: NDArray[np.int64]

    @property
    def worn(self) -> NDArray[np.bool_]:
        """(F,) whether a face is of a garment or a shoe."""
        return np.array([name not in BODY_REGIONS for name in self.names], dtype=bool)[self.of_face]


@dataclass(frozen=True, slots=True)
class RegionErrors:
    """The errors of one region; None where no point tells.

    Attributes:
        area_share: Of the true surface, 0 to 1.
        accuracy_mm: Mean distance to the true surface of the predicted points nearest to the
            region.
        completeness_mm: Mean distance of the region's true points to the predicted surface.
        normal_error_deg: Mean angle between the normals of the predicted points nearest to the
            region and there.
        missing_share: Of the region's true points, those more than ``FAR_MM`` off: a missing limb.
        bulge_share: Of the predicted points nearest to the region, those more than ``FAR_MM`` off.
        n_predicted: Predicted points nearest to the region.
        n_truth: True points on the region.
    """

    area_share: float
    accuracy_mm: float | None
    completeness_mm: float | None
    normal_error_deg: float | None
    missing_share: float | None
    bulge_share: float | None
    n_predicted: int
    n_truth: int

    def to_dict(self) -> dict[str, float | int | None]:
        """Plain JSON values."""
        return asdict(self)


def region_errors(
    predicted: PointErrors, truth: PointErrors, surface: Mesh, regions: FaceRegions
) -> dict[str, RegionErrors]:
    """The errors of every region that has an area, by name.

    Weighted by their points, the regions' means add up to the mean over the whole surface.

    Args:
        predicted: Errors of the points on the prediction.
        truth: Errors of the points on the true surface.
        surface: The true surface.
        regions: Of its faces.
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
    near: NDArray[np.bool_],
    truth: PointErrors,
    on: NDArray[np.bool_],
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


def _mean(values: NDArray[np.float64] | NDArray[np.bool_]) -> float | None:
    return float(values.mean()) if len(values) else None
