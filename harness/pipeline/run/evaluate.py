"""``harness eval``: render what is missing, reconstruct, score, file records; resume by default.

Every step runs in its own child process and every record is written whole, so that a run that is
killed at any moment is continued by the same command. A failed subject is a record with its reason,
unless there is a good record and the failure is not the method's: then that record stays.

Before: ``metrics/distance.py``. After: ``reports/formats/latex.py``.
"""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from harness.core.artifacts import Capture
from harness.core.errors import HarnessError, MissingPart
from harness.core.process.interrupts import in_threads
from harness.core.process.workers import WorkerDied, run_worker
from harness.core.records import Record
from harness.pipeline.inputs.captures import PHOTOS, photograph
from harness.pipeline.inputs.sealed import Look, admit
from harness.pipeline.progress import Progress
from harness.pipeline.run.cell_result import CellResult
from harness.pipeline.run.environment import environment, utc_now
from harness.pipeline.run.plan import Cell, EvalRequest, Evidence, plan, plan_cell, resolve_method
from harness.pipeline.run.store import Outcome

__all__ = ["EvalSummary", "evaluate"]

_CELLS = "reconstructions"
#: How often a cell is planned again because photos, scan or code changed under it.
_ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class EvalSummary:
    """How a run ended.

    Attributes:
        outcomes: All cells of the request, by subject and method.
    """

    outcomes: tuple[Outcome, ...]

    @property
    def records(self) -> tuple[Record, ...]:
        """All records of the request."""
        return tuple(outcome.record for outcome in self.outcomes)

    @property
    def cached(self) -> int:
        """How many records were there before, and are current."""
        return sum(outcome.cached for outcome in self.outcomes)

    @property
    def counts(self) -> Mapping[str, int]:
        """Number of cells by status; ``stale`` are good records that could not be made anew."""
        return Counter(outcome.status for outcome in self.outcomes)


def evaluate(request: EvalRequest, progress: Progress) -> EvalSummary:
    """Carry a request out and return all its records.

    Raises:
        HarnessError: the request itself is wrong (unknown names, no dataset, sealed subjects and no
            reason); what goes wrong with one subject is a record instead.
        Interrupted: the run was stopped; cells that were not finished have no new record.
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
    outcomes = in_threads(
        lambda subject: _subject(request, subject, progress), request.source.subjects, request.jobs
    )
    return EvalSummary(tuple(outcome for found in outcomes for outcome in found))


def _subject(request: EvalRequest, subject: str, progress: Progress) -> list[Outcome]:
    """All methods on one subject."""
    evidence = _evidence(request, subject, progress)
    if isinstance(evidence, Evidence):
        for warning in evidence.capture.warnings:
            progress.say(f"{subject}: {warning}")
    outcomes = []
    for method in request.methods:
        with request.store.locked(method, subject):
            # Planned under the lock: another run may have filed the record meanwhile.
            outcome = _cell(request, method, subject, evidence, progress)
        if outcome.status != "ok":
            progress.say(outcome.told)
        outcomes.append(outcome)
        progress.done(_CELLS)
    return outcomes


def _evidence(request: EvalRequest, subject: str, progress: Progress) -> Evidence | HarnessError:
    """Photos, made if need be, and scan; or why there are none."""
    try:
        capture = photograph(request.source, subject, progress, request.timeout_s)
        return Evidence(capture, request.source.locate(subject))
    except HarnessError as error:
        return error


def _cell(
    request: EvalRequest,
    method: str,
    subject: str,
    evidence: Evidence | HarnessError,
    progress: Progress,
) -> Outcome:
    """One cell: its record as it is, or the outcome of reconstructing."""
    result, cell = CellResult("failed"), Cell(method, subject, "", "run", "")
    for _ in range(_ATTEMPTS):
        if not isinstance(evidence, Evidence):
            result = _failure(evidence, by_method=False)
            return _filed(request, Cell(method, subject, "", "run", ""), result, None)
        cell = plan_cell(request, method, subject, evidence)
        record = request.store.record(method, subject) if cell.state == "cached" else None
        if record is not None:
            return Outcome(record, cached=True)
        result = _carried_out(request, cell)
        if result.status != "changed":
            return _filed(request, cell, result, evidence.capture)
        progress.say(f"{method} on {subject} is planned again: {result.reason}")
        evidence = _evidence(request, subject, progress)
    reason = f"after {_ATTEMPTS} attempts, {result.reason}"
    return _filed(request, cell, CellResult("failed", reason, by_method=False), None)


def _carried_out(request: EvalRequest, cell: Cell) -> CellResult:
    """What a worker made of a planned cell."""
    assert cell.inputs is not None
    job = {
        "source": request.source.to_job(),
        "subject": cell.subject,
        "method": cell.method,
        "settings": dict(request.settings),
        "protocol": request.protocol.name,
        "seed": request.seed,
        "key": cell.key,
        "inputs": cell.inputs.to_dict(),
        "folder": str(request.store.attempt(cell.method, cell.subject)),
        "keep": request.keep,
    }
    log = request.store.cell(cell.method, cell.subject) / "log.txt"
    try:
        told = run_worker(
            "harness.pipeline.run.cell_worker", job, log=log, timeout_s=request.timeout_s
        )
    except WorkerDied as error:
        # Memory may have run out because of others, and a person may have killed it.
        return _failure(error, by_method=error.by_signal != signal.SIGKILL)
    except HarnessError as error:
        return _failure(error, by_method=False)
    return CellResult.from_dict(told)


def _failure(error: HarnessError, *, by_method: bool) -> CellResult:
    status = "missing" if isinstance(error, MissingPart) else "failed"
    return CellResult(status, str(error), by_method=by_method)


def _filed(
    request: EvalRequest, cell: Cell, result: CellResult, capture: Capture | None
) -> Outcome:
    record = _record(request, cell, result, capture)
    return request.store.file(record, own_failure=result.by_method)


def _record(
    request: EvalRequest, cell: Cell, result: CellResult, capture: Capture | None
) -> Record:
    assert result.status != "changed"
    return Record(
        key=cell.key,
        method=resolve_method(cell.method, request.settings).info.to_dict(),
        dataset=request.source.name,
        subject=cell.subject,
        recipe=request.source.recipe.name,
        protocol={**request.protocol.to_dict(), "sha": request.protocol.sha},
        capture={
            "key": capture.key if capture else "",
            "warnings": list(capture.warnings) if capture else [],
        },
        seed=request.seed,
        status=result.status,
        reason=result.reason,
        metrics=result.metrics,
        stages=result.stages,
        details=result.details,
        environment=result.environment or environment(),
        created_utc=utc_now(),
        scale_rule=request.source.scale_rule,
        inputs=cell.inputs.to_dict() if cell.inputs else {},
        files=result.files,
    )
