"""The run matrix: which cells there are, which are cached, which have to run, and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from harness.core.artifacts import Capture, Scan
from harness.core.errors import DataError, HarnessError
from harness.core.process.differences import listed_differences
from harness.core.protocols import Method
from harness.core.settings import MetricProtocol
from harness.pipeline.inputs.sources import Source
from harness.pipeline.run.record_inputs import Inputs, evaluated
from harness.pipeline.run.store import RunStore

__all__ = [
    "Cell",
    "EvalRequest",
    "Evidence",
    "method_module",
    "plan",
    "plan_cell",
    "resolve_method",
]


@dataclass(frozen=True, slots=True)
class EvalRequest:
    """What ``harness eval`` was asked for.

    Attributes:
        source: Subjects and their photos.
        methods: Names in the catalogue.
        protocol: How meshes become numbers.
        store: Where records go.
        seed: Root of all randomness.
        jobs: Subjects worked on at once.
        settings: Settings of the methods that differ from their defaults, as text.
        keep: Whether intermediate results are kept beside the mesh.
        reason: Why sealed subjects are evaluated; asked for nowhere else.
        timeout_s: How long photos of a subject, or a cell, may take; None is no limit.
    """

    source: Source
    methods: tuple[str, ...]
    protocol: MetricProtocol
    store: RunStore
    seed: int = 0
    jobs: int = 1
    settings: Mapping[str, str] = field(default_factory=dict)
    keep: bool = False
    reason: str = ""
    timeout_s: float | None = 3600.0


@dataclass(frozen=True, slots=True)
class Cell:
    """One method on one subject, and what there is of it.

    Attributes:
        method, subject: Which cell.
        key: Content id of its inputs; empty while the photos are not there.
        state: ``cached`` or ``run``.
        why: Why it has to run, or what it will wait for.
        inputs: What ``key`` is the content id of.
    """

    method: str
    subject: str
    key: str
    state: str
    why: str
    inputs: Inputs | None = None

    def to_dict(self) -> dict[str, str]:
        """Plain JSON values, without the inputs."""
        return {name: getattr(self, name) for name in ("method", "subject", "key", "state", "why")}


def resolve_method(name: str, settings: Mapping[str, str]) -> Method:
    """A method by name, with some settings changed.

    Raises:
        HarnessError: an unknown method or setting, or settings for a method that has none.
        MissingPart: it, or one of its parts, is not installed.
    """
    from methods.catalog import METHODS

    method: Method = METHODS.resolve(name)
    if settings:
        configured = getattr(method, "configured", None)
        if configured is None:
            raise HarnessError(
                f"method '{name}' has no settings", got=", ".join(settings), hint="Leave --set out"
            )
        method = configured(settings)
    # What a method is made of is told on demand: asked now, not after photos have been made.
    if method.info.name != name:
        raise HarnessError(
            f"method '{name}' calls itself '{method.info.name}'",
            hint="Register it under its own name",
        )
    return method


def method_module(name: str) -> str:
    """Dotted name of the module in which the catalogue has a method."""
    from methods.catalog import METHODS

    return METHODS.module(name)


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a subject's records are made from, as it lies on disk: its photos and its scan."""

    capture: Capture
    scan: Scan


def plan_cell(request: EvalRequest, method: str, subject: str, evidence: Evidence) -> Cell:
    """What has to be done for one cell, given photos and scan.

    Raises:
        HarnessError: as ``resolve_method``, or the method's source is not there.
    """
    info = resolve_method(method, request.settings).info
    inputs = evaluated(
        info,
        method_module(method),
        evidence.capture,
        evidence.scan,
        request.protocol,
        request.seed,
    )
    why = _why_not_cached(request, method, subject, inputs)
    return Cell(method, subject, inputs.key, "run" if why else "cached", why, inputs)


def _why_not_cached(request: EvalRequest, method: str, subject: str, inputs: Inputs) -> str:
    try:
        found = request.store.record(method, subject)
    except DataError as error:
        return f"its record is unreadable: {error.what}"
    if found is None:
        return "no record yet"
    if not found.inputs:
        return f"{found.status} before: {found.reason}" if found.reason else "record's form"
    if found.key != inputs.key:
        return f"changed: {listed_differences(found.inputs, inputs.to_dict())}"
    if found.status != "ok":
        return f"{found.status} before: {found.reason}"
    return ""


def plan(request: EvalRequest) -> list[Cell]:
    """All cells of a request, by subject and then by method, without doing any work.

    A subject whose scan cannot be read has cells, too: they say so.

    Raises:
        HarnessError: as ``resolve_method``.
    """
    for method in request.methods:
        resolve_method(method, request.settings)
    return [cell for subject in request.source.subjects for cell in _cells(request, subject)]


def _cells(request: EvalRequest, subject: str) -> list[Cell]:
    source = request.source
    try:
        state, why = source.capture_state(subject)
        if state == "cached":
            evidence = Evidence(
                Capture.load(source.capture_directory(subject)), source.locate(subject)
            )
            return [plan_cell(request, method, subject, evidence) for method in request.methods]
        waits_for = f"photos {state}: {why}"
    except DataError as error:
        waits_for = str(error)
    return [Cell(method, subject, "", "run", waits_for) for method in request.methods]
