"""The errors of each region of a scan whose faces are labelled, as a record holds them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harness.core.array_files.npz import read_array_npz
from harness.core.artifacts import Scan
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.settings import MetricProtocol

if TYPE_CHECKING:
    from metrics.regions import FaceRegions
    from metrics.score import Misplaced, Score

__all__ = ["labelled_faces", "region_details", "scored"]


def scored(
    predicted: Mesh,
    scan: Scan,
    truth: Mesh,
    protocol: MetricProtocol,
    *,
    misplaced: Misplaced = "refuse",
) -> tuple[Score, dict[str, object]]:
    """A mesh's score against a scan, and what a record tells of it besides its metrics.

    Args:
        predicted: What to score.
        scan: Where the truth came from.
        truth: The scan's mesh in world metres.
        protocol: How.
        misplaced: What becomes of a prediction in another unit or frame, as in ``score``.

    Raises:
        DataError: a mesh that cannot be compared, or labels that are not the scan's.
    """
    from metrics.score import score

    regions = labelled_faces(scan, truth)
    outcome = score(
        predicted, truth, protocol, keep_points=regions is not None, misplaced=misplaced
    )
    return outcome, {
        "diagnostics": outcome.diagnostics,
        "warnings": list(outcome.warnings),
        **region_details(outcome, truth, regions),
    }


def labelled_faces(scan: Scan, truth: Mesh) -> FaceRegions | None:
    """The regions of a scan's faces, or None where the dataset has no labels.

    Args:
        scan: Where the labels lie.
        truth: The scan's mesh, with its faces in the file's order.

    Raises:
        DataError: the file is not one that the avatars' generator writes, or is of another mesh.
    """
    from metrics.regions import FaceRegions

    path = scan.labels_path
    if path is None:
        return None
    try:
        file = read_array_npz(path, ("face_labels", "names"))
        labels = file["face_labels"].astype(np.int64)
        names = tuple(str(name) for name in file["names"])
    except (DataError, KeyError, ValueError) as error:
        raise DataError(f"{path} holds no labels of faces", got=repr(error)) from error
    if labels.shape != (len(truth.faces),):
        raise DataError(
            f"{path} does not fit {scan.mesh_path.name}",
            expected=f"{len(truth.faces)} labels, one per face",
            got=f"shape {labels.shape}",
        )
    if not 0 <= labels.min() <= labels.max() < len(names):
        raise DataError(
            f"{path} has faces of no named region",
            expected=f"labels from 0 to {len(names) - 1}",
            got=f"{labels.min()} to {labels.max()}",
        )
    return FaceRegions(names, labels)


def region_details(
    outcome: Score, truth: Mesh, regions: FaceRegions | None
) -> dict[str, dict[str, dict[str, float | int | None]]]:
    """``{"regions": {name: errors}}`` for a record's details; empty without labels.

    Args:
        outcome: A score with its errors point by point.
        truth: The scan's mesh.
        regions: Of its faces.
    """
    from metrics.regions import region_errors

    if regions is None or outcome.predicted_points is None or outcome.truth_points is None:
        return {}
    found = region_errors(outcome.predicted_points, outcome.truth_points, truth, regions)
    return {"regions": {name: errors.to_dict() for name, errors in found.items()}}
