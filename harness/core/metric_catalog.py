"""What each metric is called, is printed in, and where its definition comes from."""

from collections.abc import Mapping
from dataclasses import dataclass

from harness.core.units import Unit


@dataclass(frozen=True, slots=True)
class MetricDescription:
    """A metric as tables name it; lower is better, except for an intersection over union.

    Attributes:
        id: As in records and files.
        title: For people, without unit.
        latex_title: The same as LaTeX source.
        unit: Symbol of the unit that every record of it carries.
        digits: Decimals shown.
        source: Where the definition is written down.
        definition: What it is, in a sentence; exactly, see ``metrics/``.
    """

    id: str
    title: str
    latex_title: str
    unit: str
    digits: int
    source: str
    definition: str


_MM, _DEG = Unit.millimetre.value, Unit.degree.value
_NONE, _RATIO = Unit.none.value, Unit.ratio.value
_PAPER = "MExECON, section Metrics"
_PAPER_JMBO = "MExECON, section Joint Multi-view Body Optimization"
_OURS, _CAMERAS = "metrics/body.py", "metrics/cameras.py"

_DESCRIPTIONS = (
    MetricDescription(
        "chamfer", "Chamfer", "Chamfer", _MM, 2, _PAPER,
        "Mean of the two mean distances between the surfaces, from each to the other: between "
        "sampled points under protocol mexecon (hence its sampling floor), from sampled points to "
        "the surface under protocol exact.",
    ),
    MetricDescription(
        "p2s_accuracy", "P2S Acc.", "P2S Acc.", _MM, 2, _PAPER,
        "Mean distance from points sampled on the prediction to the true surface.",
    ),
    MetricDescription(
        "p2s_completeness", "P2S Comp.", "P2S Comp.", _MM, 2, _PAPER,
        "Mean distance from points sampled on the truth to the predicted surface.",
    ),
    MetricDescription(
        "normal_error", "Normal", "Normal", _DEG, 2, _PAPER,
        "Mean angle between the oriented smooth normals of points sampled on the prediction and of "
        "their closest points on the truth; under protocol mexecon with the permuted weights and "
        "the split seams of the published evaluator.",
    ),
    MetricDescription(
        "silhouette_loss", "Silhouette loss", "Silhouette loss", _NONE, 4, _PAPER_JMBO,
        "Area where the silhouettes of the fitted body and of the scan differ, as a share of the "
        "square frame around the subject; mean over the views.",
    ),
    MetricDescription(
        "landmark_loss", "Landmark loss", "Landmark loss", _NONE, 4, _PAPER_JMBO,
        "Confidence-weighted mean distance between the body's landmarks and those detected in the "
        "photo, in half sides of the frame; mean over the views.",
    ),
    MetricDescription(
        "normal_loss", "Normal loss", "Normal loss", _NONE, 4, _PAPER_JMBO,
        "Mean absolute difference of the normals of the fitted body and of the scan where both "
        "are seen, over the frame; mean over the views.",
    ),
    MetricDescription(
        "total_loss", "Total loss", "Total loss", _NONE, 4, _PAPER_JMBO,
        "Silhouette loss + 0.2 normal loss + 0.1 landmark loss.",
    ),
    MetricDescription(
        "joint_error", "Joint error", "Joint error", _MM, 1, _OURS,
        "Mean distance of 12 main joints of the fitted body from the true body's, not aligned.",
    ),
    MetricDescription(
        "vertex_error", "Vertex error", "Vertex error", _MM, 1, _OURS,
        "Mean distance of the fitted body's vertices from the true body's, not aligned.",
    ),
    MetricDescription(
        "off_model", "Off the model", "Off the model", _MM, 1, _OURS,
        "Of the subject, not of the method: root mean square distance of the true body's vertices "
        "from those that the fitted model gives for the subject's own parameters.",
    ),
    MetricDescription(
        "silhouette_iou", "Silhouette IoU", "Silhouette IoU", _RATIO, 3, _OURS,
        "Intersection over union of the silhouettes of the fitted body and of the scan, mean over "
        "the views; more is better. A clothed scan's silhouette is larger than its true body's.",
    ),
    MetricDescription(
        "camera_rotation", "Rotation", "Rotation", _DEG, 3, _CAMERAS,
        "Mean angle between estimated and true relative rotations, over all pairs of photos.",
    ),
    MetricDescription(
        "camera_rotation_sd", "Rotation SD", "Rotation SD", _DEG, 3, _CAMERAS,
        "Standard deviation of a camera's turn that the search for cameras itself tells, without "
        "the truth; median of the photos.",
    ),
    MetricDescription(
        "camera_direction", "Direction", "Direction", _DEG, 3, _CAMERAS,
        "Mean angle between estimated and true directions from one camera of a pair to the other.",
    ),
    *(
        MetricDescription(
            f"camera_auc_{deg}", f"AUC at {deg}", f"AUC at {deg}", _RATIO, 3, _CAMERAS,
            "Mean over all pairs of max(0, 1 - e / t) with e the larger of the pair's rotation and "
            f"direction error, t = {deg} degrees; more is better.",
        )
        for deg in (1, 3, 5, 10)
    ),
    MetricDescription(
        "camera_position", "Position", "Position", _MM, 1, _CAMERAS,
        "Mean distance of the estimated camera centres from the true ones, after a Sim(3) by "
        "cameras.",
    ),
    MetricDescription(
        "camera_reprojection", "Reprojection", "Reprojection", Unit.pixel.value, 2, _CAMERAS,
        "Root mean square distance between where estimated and true cameras see points of the "
        "scan, after the Sim(3) by which they show a cube before them alike.",
    ),
)  # fmt: skip

#: Every metric by id, in the order of the paper's table.
METRICS: Mapping[str, MetricDescription] = {entry.id: entry for entry in _DESCRIPTIONS}
