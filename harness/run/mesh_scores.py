"""The scores of a mesh against a scan, with the errors of each region where faces are labelled."""

from harness.core.artifacts import Scan
from harness.core.mesh import Mesh
from harness.core.records import Scores
from harness.core.settings import MetricProtocol
from harness.core.truth import face_regions
from metrics.regions import region_errors
from metrics.score import Misplaced, score


def mesh_scores(
    predicted: Mesh,
    scan: Scan,
    truth: Mesh,
    protocol: MetricProtocol,
    *,
    misplaced: Misplaced = "refuse",
) -> Scores:
    """A mesh's metrics against a scan, its errors by region, warnings and diagnostics.

    Args:
        predicted: What to score.
        scan: Where the truth came from.
        truth: The scan's mesh in world metres, with its faces in the file's order.
        protocol: How.
        misplaced: What becomes of a prediction in another unit or frame, as in ``score``.

    Raises:
        DataError: a mesh that cannot be compared, or labels that are not the scan's.
    """
    has_points = any(column.of == "angle" for column in protocol.columns)
    labels = face_regions(scan, truth) if has_points else None
    found = score(predicted, truth, protocol, keep_points=labels is not None, misplaced=misplaced)
    regions = {}
    if labels and found.predicted_points and found.truth_points:
        regions = region_errors(found.predicted_points, found.truth_points, truth, labels)
    return Scores(
        metrics=found.metrics,
        regions=regions,
        warnings=found.warnings,
        diagnostics=found.diagnostics,
    )
