"""The numbers of one result, as metrics hand them to the pipeline and records to the reports.

Every value here goes to JSON and back by ``harness.core.formats.typed_json``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Literal


@dataclass(frozen=True, slots=True)
class MetricValue:
    """The estimate of one metric; lower is better, except for an intersection over union."""

    value: float
    """In ``unit``."""
    unit: str
    """Symbol, such as ``mm`` or ``deg``."""
    n: int
    """How many points or views it is the mean of."""
    standard_error: float
    """What the sampling of points leaves uncertain, in ``unit``."""
    floor: float = 0.0
    """What the truth itself scores because of the sampling, where that is not 0."""


@dataclass(frozen=True, slots=True)
class RegionErrors:
    """The errors of one labelled region of the true surface; None where it has no points."""

    area_share: float
    """The region's share of the true surface, 0 to 1."""
    accuracy_mm: float | None
    """Mean distance to the true surface of the predicted points nearest to the region."""
    completeness_mm: float | None
    """Mean distance of the region's true points to the predicted surface."""
    normal_error_deg: float | None
    """Mean angle between the normals of the predicted points nearest to the region and there."""
    missing_share: float | None
    """Share of the region's true points that are far from the prediction: a missing limb."""
    bulge_share: float | None
    """Share of the predicted points nearest to the region that are far from the truth."""
    n_predicted: int
    """Predicted points nearest to the region."""
    n_truth: int
    """True points on the region."""


@dataclass(frozen=True, slots=True)
class AngularErrors:
    """The angles between two normal maps over some pixels; None where there are no pixels."""

    mean_deg: float | None
    median_deg: float | None
    share_below_11_25: float | None
    """Share of the pixels, 0 to 1, with an error below 11.25 degrees."""
    share_below_22_5: float | None
    """The same for 22.5 degrees."""
    share_below_30: float | None
    """The same for 30 degrees."""
    n: int
    """Pixels."""


@dataclass(frozen=True, slots=True)
class AngularPair:
    """The errors of an estimate, and of the fitted body's own normals on the same pixels."""

    estimate: AngularErrors
    body: AngularErrors


@dataclass(frozen=True, slots=True)
class FoldErrors:
    """The folds of an estimated normal map and the scan's on the same pixels (`metrics.folds`)."""

    estimate_deg: float
    """Fold strength of the estimate: mean angle between normals and their blur, degrees."""
    truth_deg: float
    """The same of the scan."""
    correlation: float
    """How well both agree in what the blur takes away: 1 alike, 0 unrelated."""


@dataclass(frozen=True, slots=True)
class NormalMapErrors:
    """The errors of a method's normal maps in one view, on one side of the subject."""

    view: int
    """Index of the photo, counted from the front."""
    yaw_deg: float
    """Its camera's yaw from the subject's front towards its left, whole degrees, 0 to 359."""
    side: Literal["near", "far"]
    """The surface that the photo shows, or the last one along the same rays."""
    clothed: AngularPair | None
    """Over the pixels of garments and shoes; None where the scan has no labels."""
    whole: AngularPair
    """Over all pixels of the subject."""
    folds: FoldErrors | None
    """Over the same pixels; None where the map is too coarse, or the subject too small in it."""


@dataclass(frozen=True, slots=True)
class BodyErrors:
    """The errors of a fitted body; None where the body or the dataset does not allow a metric.

    Fields are named by metric id, in the order in which records list them.
    """

    silhouette_loss: MetricValue | None = None
    normal_loss: MetricValue | None = None
    landmark_loss: MetricValue | None = None
    silhouette_iou: MetricValue | None = None
    total_loss: MetricValue | None = None
    off_model: MetricValue | None = None
    joint_error: MetricValue | None = None
    vertex_error: MetricValue | None = None

    def by_id(self) -> dict[str, MetricValue]:
        """The metrics that there are, by metric id."""
        found: dict[str, MetricValue | None] = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in found.items() if value is not None}


@dataclass(frozen=True, slots=True)
class DistanceSummary:
    """Percentiles of the sampled distances in one direction."""

    p50_mm: float
    p90_mm: float
    p95_mm: float
    p99_mm: float
    max_sampled_mm: float
    """The largest of them: a lower bound of the Hausdorff distance, which grows with the number of
    points."""


@dataclass(frozen=True, slots=True)
class FScore:
    """Shares of the points, 0 to 1, that are closer to the other surface than a threshold."""

    precision: float
    """Share of the predicted points."""
    recall: float
    """Share of the true points."""
    f: float
    """Harmonic mean of both; 0 where both are 0."""


@dataclass(frozen=True, slots=True)
class NormalSummary:
    """What tells wrong orientation from wrong shape."""

    median_deg: float
    share_over_90: float
    """Share of the predicted normals that point away from the true ones."""
    unoriented_mean_deg: float
    """The mean when a normal and its opposite count as the same, as in some evaluations."""
    truth_to_predicted_mean_deg: float | None
    """The mean over the points of the truth; None where no point has two normals to compare."""


@dataclass(frozen=True, slots=True)
class MeshFacts:
    """Size and health of a mesh."""

    vertices: int
    faces: int
    faces_without_area: int
    extent_m: tuple[float, float, float]
    """Sides of the bounding box along x, y and z."""
    area_m2: float
    signed_volume_m3: float | None
    """None for an open surface, whose volume has no meaning."""
    inverted: bool | None
    """Whether the faces of a (nearly) closed surface are wound inside out; None for an open one."""


@dataclass(frozen=True, slots=True)
class Diagnostics:
    """What stands behind the means of a score."""

    alignment: str
    """``none``: nothing is ever aligned."""
    predicted_to_truth: DistanceSummary
    truth_to_predicted: DistanceSummary
    f_score: Mapping[str, FScore]
    """By threshold, such as ``5_mm``."""
    normals: NormalSummary
    meshes: Mapping[str, MeshFacts]
    """Facts about the ``predicted`` mesh and about the ``truth``."""


@dataclass(frozen=True, slots=True)
class Scores:
    """Every number of one result, and what a reader of them should know."""

    metrics: Mapping[str, MetricValue] = field(default_factory=dict[str, MetricValue])
    """By metric id."""
    regions: Mapping[str, RegionErrors] = field(default_factory=dict[str, RegionErrors])
    """By region's name; empty where the scan has no labels."""
    normal_maps: tuple[NormalMapErrors, ...] = ()
    """One entry for each view and side; empty for a method without normal maps."""
    warnings: tuple[str, ...] = ()
    """Doubts about units, frame or winding of the meshes."""
    diagnostics: Diagnostics | None = None
    """What stands behind the means; None where nothing was measured."""
