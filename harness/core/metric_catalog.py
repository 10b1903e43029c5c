"""What each metric is called, in which unit it is printed, and where its definition comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from harness.core.units import Unit

__all__ = ["METRICS", "MetricDescription"]


@dataclass(frozen=True, slots=True)
class MetricDescription:
    """A metric as tables name it; lower is better for every one.

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
_PAPER = "MExECON, section Metrics"

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
        "their closest points on the truth.",
    ),
)  # fmt: skip

#: Every metric by id, in the order of the paper's table.
METRICS: Mapping[str, MetricDescription] = {entry.id: entry for entry in _DESCRIPTIONS}
