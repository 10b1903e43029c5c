"""A planned cell, as it travels to the worker process that carries it out, and what comes back."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from harness.core.artifacts import StageCost
from harness.core.records import Environment, Scores, Status
from harness.run.method_choice import MethodRef
from harness.run.record_inputs import Inputs
from harness.run.sources import Source


@dataclass(frozen=True, slots=True)
class CellJob:
    """One method on one subject, as it was planned.

    Attributes:
        source: The dataset and the recipe, with this subject alone.
        method: The method with its settings.
        protocol: How the result is scored, by name.
        seed: Root seed of the run.
        inputs: What the record is made from; its key is the record's.
        folder: Receives mesh, body and normals.
        keep: Whether intermediate results stay.
        share: Whether work that was made for another method before is taken over.
    """

    source: Source
    method: MethodRef
    protocol: str
    seed: int
    inputs: Inputs
    folder: Path
    keep: bool
    share: bool = True

    @property
    def subject(self) -> str:
        """The subject's id."""
        return self.source.subjects[0]


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
