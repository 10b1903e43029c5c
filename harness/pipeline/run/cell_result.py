"""What a worker returns about one cell, as it travels from process to process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from harness.core.artifacts import StageCost
from harness.core.formats.typed_json import from_json, to_json
from harness.core.records import Environment, Status
from harness.core.results import Scores


@dataclass(frozen=True, slots=True)
class CellResult:
    """How an attempt at a cell ended.

    Attributes:
        status: A record's, or ``changed``: photos, scan or code are not those that were planned,
            and nothing may be filed.
        reason: Why not ``ok``.
        by_method: Whether a failure is the method's own; others never replace a good record.
        scores: The numbers; none unless ``ok``.
        stages, shared_work, details, files: As in ``Record``.
        environment: The worker's; None where there was no worker.
    """

    status: Status | Literal["changed"]
    reason: str = ""
    by_method: bool = True
    scores: Scores = field(default_factory=Scores)
    stages: tuple[StageCost, ...] = ()
    shared_work: tuple[str, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict[str, object])
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    environment: Environment | None = None

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return to_json(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, object]) -> CellResult:
        """The result behind ``to_dict``.

        Raises:
            DataError: the values are not those of a result.
        """
        return from_json(cls, values, "the worker's answer", "a cell's result")
