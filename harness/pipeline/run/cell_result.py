"""What a worker returns about one cell, as it travels from process to process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from harness.core.artifacts import StageCost
from harness.core.records import MetricValue, Status

__all__ = ["CellResult"]


@dataclass(frozen=True, slots=True)
class CellResult:
    """How an attempt at a cell ended.

    Attributes:
        status: A record's, or ``changed``: photos, scan or code are not those that were planned,
            and nothing may be filed.
        reason: Why not ``ok``.
        by_method: Whether a failure is the method's own; others never replace a good record.
        metrics, stages, details, files: As in ``Record``.
        environment: Where and with what the worker ran; empty where there was none.
    """

    status: Status | Literal["changed"]
    reason: str = ""
    by_method: bool = True
    metrics: Mapping[str, MetricValue] = field(default_factory=dict[str, MetricValue])
    stages: tuple[StageCost, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict[str, object])
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    environment: Mapping[str, object] = field(default_factory=dict[str, object])

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> CellResult:
        """The result behind ``to_dict``."""
        metrics = {name: MetricValue(**value) for name, value in values["metrics"].items()}
        stages = tuple(StageCost(**stage) for stage in values["stages"])
        return cls(**{**values, "metrics": metrics, "stages": stages})
