"""``harness eval``: render what is missing, reconstruct, score, file records; resume by default.

Every step runs in its own child process and every record is written whole, so that a run that is
killed at any moment is continued by the same command. A failed subject is a record with its reason.

Before: ``metrics/distance.py``. After: ``reports/latex.py``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from harness.core.artifacts import Capture, StageCost
from harness.core.errors import HarnessError, MissingPart
from harness.core.records import MetricValue, Record
from harness.core.workers import run_worker
from harness.pipeline.captures import PHOTOS, photograph
from harness.pipeline.environment import environment, utc_now
from harness.pipeline.plan import EvalRequest, plan, plan_cell, record_key, resolve_method
from harness.pipeline.progress import Progress
from harness.pipeline.sealed import Look, admit

__all__ = ["EvalSummary", "evaluate"]

_CELLS = "reconstructions"


@dataclass(frozen=True, slots=True)
class EvalSummary:
    """How a run ended.

    Attributes:
        records: All records of the request, by subject and method.
        cached: How many of them were there before.
    """

    records: tuple[Record, ...]
    cached: int

    @property
    def counts(self) -> Mapping[str, int]:
        """Number of records by status."""
        return Counter(record.status for record in self.records)


def evaluate(request: EvalRequest, progress: Progress) -> EvalSummary:
    """Carry a request out and return all its records.

    Raises:
        HarnessError: the request itself is wrong (unknown names, no dataset, sealed subjects and no
            reason); what goes wrong with one subject is a record instead.
    """
    for method in request.methods:
        resolve_method(method, request.settings)
    source = request.source
    source.root()
    look = Look(
        "evaluation", source.name, source.subjects, request.reason, request.methods,
        source.recipe.name,
    )  # fmt: skip
    admit(source.manifest, source.workspace, look, progress)
    request.store.begin()
    cells = plan(request)
    waiting = {cell.subject for cell in cells if not cell.key}
    progress.expect(PHOTOS, len(waiting) * request.source.recipe.rig.views)
    progress.expect(_CELLS, len(cells))
    with ThreadPoolExecutor(max_workers=max(1, request.jobs)) as pool:
        outcomes = list(
            pool.map(lambda subject: _subject(request, subject, progress), request.source.subjects)
        )
    return EvalSummary(
        records=tuple(record for records, _ in outcomes for record in records),
        cached=sum(cached for _, cached in outcomes),
    )


def _subject(request: EvalRequest, subject: str, progress: Progress) -> tuple[list[Record], int]:
    """All methods on one subject."""
    capture: Capture | None = None
    failure: HarnessError | None = None
    try:
        capture = photograph(request.source, subject, progress)
    except HarnessError as error:
        failure = error
    photos = {
        "key": capture.key if capture else "",
        "warnings": list(capture.warnings) if capture else [],
    }
    for warning in photos["warnings"]:
        progress.say(f"{subject}: {warning}")
    records, cached = [], 0
    for method in request.methods:
        with request.store.locked(method, subject):
            # Planned under the lock: another run may have filed the record meanwhile.
            cell = plan_cell(request, method, subject, str(photos["key"]))
            record = request.store.record(method, subject) if cell.state == "cached" else None
            cached += record is not None
            if record is None:
                record = _run_cell(request, method, subject, photos, failure)
                record.save(request.store.cell(method, subject) / "record.json")
        if record.status != "ok":
            progress.say(f"{method} on {subject} {record.status}: {record.reason}")
        records.append(record)
        progress.done(_CELLS)
    return records, cached


def _run_cell(
    request: EvalRequest,
    method: str,
    subject: str,
    capture: Mapping[str, object],
    failure: HarnessError | None,
) -> Record:
    info = resolve_method(method, request.settings).info.to_dict()
    cell = request.store.cell(method, subject)
    result: Mapping[str, object] = {}
    try:
        if failure is not None:
            raise failure
        result = run_worker(
            "harness.pipeline.cell_worker",
            {
                "source": request.source.to_job(),
                "subject": subject,
                "method": method,
                "settings": dict(request.settings),
                "protocol": request.protocol.name,
                "seed": request.seed,
                "cell": str(cell),
                "keep": request.keep,
            },
            log=cell / "log.txt",
        )
        status, reason = "ok", ""
    except MissingPart as error:
        status, reason = "missing", str(error)
    except HarnessError as error:
        status, reason = "failed", str(error)
    return Record(
        key=record_key(info, str(capture["key"]), request.protocol, request.seed),
        method=info,
        dataset=request.source.name,
        subject=subject,
        recipe=request.source.recipe.name,
        protocol={**request.protocol.to_dict(), "sha": request.protocol.sha},
        capture={"key": capture["key"], "warnings": capture["warnings"]},
        seed=request.seed,
        status=status,  # type: ignore[arg-type]
        reason=reason,
        metrics={name: MetricValue(**value) for name, value in result.get("metrics", {}).items()},  # type: ignore[attr-defined]
        stages=tuple(StageCost(**stage) for stage in result.get("stages", [])),  # type: ignore[attr-defined]
        details=dict(result.get("details", {})),  # type: ignore[call-overload]
        environment=environment(),
        created_utc=utc_now(),
        scale_rule=request.source.scale_rule,
    )
