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
    """

    id: str
    title: str
    latex_title: str
    unit: str
    digits: int
    source: str


_PAPER = "MExECON, section Metrics"
_MM, _DEG = Unit.millimetre.value, Unit.degree.value

_DESCRIPTIONS = (
    MetricDescription("chamfer", "Chamfer", "Chamfer", _MM, 2, _PAPER),
    MetricDescription("p2s_accuracy", "P2S Acc.", "P2S Acc.", _MM, 2, _PAPER),
    MetricDescription("p2s_completeness", "P2S Comp.", "P2S Comp.", _MM, 2, _PAPER),
    MetricDescription("normal_error", "Normal", "Normal", _DEG, 2, _PAPER),
)

#: Every metric by id, in the order of the paper's table.
METRICS: Mapping[str, MetricDescription] = {entry.id: entry for entry in _DESCRIPTIONS}
