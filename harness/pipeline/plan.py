"""The run matrix: which cells there are, which are cached, which have to run, and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from harness.core.errors import DataError, HarnessError
from harness.core.hashing import content_hash
from harness.core.protocols import Method
from harness.core.records import Record
from harness.core.settings import MetricProtocol
from harness.pipeline.sources import Source
from harness.pipeline.store import RunStore

__all__ = ["Cell", "EvalRequest", "plan", "plan_cell", "record_key", "resolve_method"]


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


@dataclass(frozen=True, slots=True)
class Cell:
    """One method on one subject, and what there is of it.

    Attributes:
        method, subject: Which cell.
        key: Content id of its inputs; empty while the photos are not there.
        state: ``cached`` or ``run``.
        why: Why it has to run, or what it will wait for.
    """

    method: str
    subject: str
    key: str
    state: str
    why: str


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
    _ = method.info
    return method


def record_key(
    method: Mapping[str, object], capture_key: str, protocol: MetricProtocol, seed: int
) -> str:
    """Content id of all that a record's numbers depend on."""
    return content_hash(
        {"method": method, "capture": capture_key, "protocol": protocol.to_dict(), "seed": seed}
    )


def plan_cell(request: EvalRequest, method: str, subject: str, capture_key: str) -> Cell:
    """What has to be done for one cell, given the key of its photos."""
    info = resolve_method(method, request.settings).info.to_dict()
    key = record_key(info, capture_key, request.protocol, request.seed)
    try:
        found = request.store.record(method, subject)
    except DataError as error:
        return Cell(method, subject, key, "run", f"its record is unreadable: {error.what}")
    if found is None:
        return Cell(method, subject, key, "run", "no record yet")
    if found.key != key:
        changed = _changed(found, info, capture_key, request)
        return Cell(method, subject, key, "run", f"changed: {', '.join(changed)}")
    if found.status != "ok":
        return Cell(method, subject, key, "run", f"{found.status} before: {found.reason}")
    return Cell(method, subject, key, "cached", "")


def _changed(
    found: Record, info: Mapping[str, object], capture_key: str, request: EvalRequest
) -> list[str]:
    pairs = {
        **{f"method {name}": (found.method.get(name), value) for name, value in info.items()},
        "photos": (found.capture.get("key"), capture_key),
        "protocol": (found.protocol.get("sha"), request.protocol.sha),
        "seed": (found.seed, request.seed),
    }
    return [name for name, (before, now) in pairs.items() if before != now] or ["record's form"]


def plan(request: EvalRequest) -> list[Cell]:
    """All cells of a request, by subject and then by method, without doing any work.

    Raises:
        HarnessError: as ``resolve_method``.
    """
    for method in request.methods:
        resolve_method(method, request.settings)
    cells = []
    for subject in request.source.subjects:
        state, why = request.source.capture_state(subject)
        if state == "cached":
            key = request.source.capture_key(subject)
            cells += [plan_cell(request, method, subject, key) for method in request.methods]
        else:
            cells += [
                Cell(method, subject, "", "run", f"photos {state}: {why}")
                for method in request.methods
            ]
    return cells
