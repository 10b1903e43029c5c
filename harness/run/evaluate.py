"""``harness eval``: render what is missing, reconstruct, score, file records; resume by default.

Every step runs in its own child process and every record is written whole, so that a run that is
killed at any moment is continued by the same command. A failed subject is a record with its reason,
unless there is a good record and the failure is not the method's: then that record stays.

Before: ``metrics/distance.py``. After: ``reports/formats/latex.py``.
"""

import signal
import threading
import uuid
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError, MissingPart, error_values, found_error
from harness.core.files.names import named_from
from harness.core.process.forks import ForkedWorker, serving
from harness.core.process.workers import WorkerDied, run_worker
from harness.core.records import CaptureStamp, ProtocolStamp, Record
from harness.core.typed_json import from_json
from harness.run.captures import expect_photos, photograph, require_avatars
from harness.run.cell_job import CellJob, CellResult
from harness.run.method_choice import ChosenMethod
from harness.run.plan import Cell, EvalRequest, RequestJob, SubjectFiles, SubjectJob, plan
from harness.run.progress import PhotoSteps, Progress
from harness.run.protocol_scores import require_aligned
from harness.run.publication import Attempt
from harness.run.record_inputs import environment, utc_now
from harness.run.sealed import Look, admit
from harness.run.store import Outcome
from harness.run.task import Answer, Local, Task, machine_facts

#: Name of the progress bar that counts cells.
CELLS = "reconstructions"
_HANDLERS = "harness.run.evaluate"

#: ``given_up(row, subject, reason)``: files a failure, and answers as a cell's task does.
GivenUp = Callable[[str, str, str], Mapping[str, object]]


@dataclass(frozen=True, slots=True)
class MachineShare:
    """What one machine did.

    Attributes:
        machine: What it is called.
        photos: Subjects whose photos it made or found.
        cells: Cells that it carried out.
        busy_s: Sum of the tasks' times, seconds.
    """

    machine: str
    photos: int = 0
    cells: int = 0
    busy_s: float = 0.0

    def __str__(self) -> str:
        return (
            f"{self.machine}: {self.cells} reconstructions, photos of {self.photos} subjects, "
            f"{self.busy_s:.0f} s"
        )


@dataclass(frozen=True, slots=True)
class _Ended:
    """A cell whose record is in the store."""

    cached: bool
    kept: str


class RunOfTasks:
    """The tasks of a request, and the answers to them.

    Args:
        request: What was asked for.
        progress: Shown what ends.
        given_up: Files the failure of a cell about which there is no answer.
    """

    def __init__(self, request: EvalRequest, progress: Progress, given_up: GivenUp) -> None:
        self._request, self._progress, self._given_up = request, progress, given_up
        # Answers come from several threads.
        self._lock = threading.Lock()
        self._photos: dict[str, str] = {}
        self._cells: dict[str, tuple[str, str]] = {}
        self._ended: dict[tuple[str, str], _Ended] = {}
        self._shares: dict[str, MachineShare] = defaultdict(lambda: MachineShare(""))

    def tasks_for(self, cells: Sequence[Cell]) -> list[Task]:
        """The tasks of cells, by subject; a cell with a current record has none."""
        run, tasks = uuid.uuid4().hex, list[Task]()
        # The same object for each task of a row, of which there may be many.
        jobs = {method.row: self._request.job([method]) for method in self._request.methods}
        jobs[""] = self._request.job([])
        for cell in cells:
            if cell.record is not None:
                self._end((cell.method.row, cell.subject), {"cached": True, "kept": "", "line": ""})
                continue
            tasks += self._tasks_of(cell, run, jobs)
        for cell in {cell.subject: cell for cell in cells if cell.files is not None}.values():
            self._warn(cell.subject, cell.files.capture.warnings if cell.files else ())
        return tasks

    def _tasks_of(self, cell: Cell, run: str, jobs: Mapping[str, RequestJob]) -> Iterator[Task]:
        subject, row = cell.subject, cell.method.row
        photos = ""
        if cell.files is None:
            photos = f"photos of {subject}"
            if photos not in self._photos:
                self._photos[photos] = subject
                job = SubjectJob(run, jobs[""], subject)
                yield Task(photos, f"{_HANDLERS}:photos", job, subject, renders=True)
        name = f"{row} on {subject}"
        self._cells[name] = (row, subject)
        yield Task(
            name, f"{_HANDLERS}:cell", SubjectJob(run, jobs[row], subject, row), subject, photos
        )

    def answered(self, answer: Answer) -> None:
        """Take the answer to a task."""
        self._count(answer)
        for line in answer.said:
            self._progress.say(line)
        if answer.task in self._photos:
            subject = self._photos[answer.task]
            warnings = answer.value.get("warnings")
            self._warn(subject, warnings if isinstance(warnings, list) else ())
            return
        row, subject = self._cells[answer.task]
        value = answer.value
        if answer.lost:
            value = self._given_up(row, subject, answer.lost)
        self._end((row, subject), value)

    def _end(self, cell: tuple[str, str], value: Mapping[str, object]) -> None:
        self._ended[cell] = _Ended(bool(value["cached"]), str(value["kept"]))
        if value["line"]:
            self._progress.say(str(value["line"]))
        self._progress.done(CELLS)

    def _warn(self, subject: str, warnings: Sequence[object]) -> None:
        for warning in warnings:
            self._progress.say(f"{subject}: {warning}")

    def _count(self, answer: Answer) -> None:
        is_photos = answer.task in self._photos
        if answer.machine:
            with self._lock:
                before = self._shares[answer.machine]
                self._shares[answer.machine] = replace(
                    before,
                    machine=answer.machine,
                    photos=before.photos + is_photos,
                    cells=before.cells + (not is_photos),
                    busy_s=before.busy_s + answer.wall_s,
                )
        # A task elsewhere says nothing of its views.
        if is_photos and self._request.executor is not None:
            source = self._request.source
            PhotoSteps(self._progress, source.views_to_render, source.camera_steps).end()

    def machines(self) -> tuple[MachineShare, ...]:
        """Which machine did what, by name."""
        return tuple(self._shares[name] for name in sorted(self._shares))

    def outcomes(self) -> tuple[Outcome, ...]:
        """All cells by subject and method, with the records that the store has of them.

        Raises:
            DataError: a record was removed meanwhile, or cannot be read.
        """
        found: list[Outcome] = []
        for subject in self._request.source.subjects:
            for method in self._request.methods:
                ended = self._ended[method.row, subject]
                folder = self._request.store.cell(method.row, subject)
                record = folder.record()
                if record is None:
                    raise DataError(
                        f"the record of {method.row} on {subject} was removed during the run",
                        hint="Run the same command again",
                    )
                found.append(Outcome(record, ended.cached, ended.kept))
        return tuple(found)


_MOST = 64


class KnownFiles:
    """Photos and scans of subjects, or why there are none; for several threads.

    A method's worker looks again whether they are still the same, so that a subject's cells can
    share what was found.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: OrderedDict[str, SubjectFiles | HarnessError] = OrderedDict()

    def get(self, subject: str) -> SubjectFiles | HarnessError | None:
        """What was found last, or None."""
        with self._lock:
            return self._found.get(subject)

    def put(self, subject: str, files: SubjectFiles | HarnessError) -> None:
        """Take this for what there is of a subject; what is oldest goes."""
        with self._lock:
            self._found[subject] = files
            self._found.move_to_end(subject)
            while len(self._found) > _MOST:
                self._found.popitem(last=False)


#: From so many cells on, a process that has imported what they need is worth its start.
_MANY = 4
_WORKER = "harness.run.cell_worker"
#: How often a cell is planned again because photos, scan or code changed under it.
_ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class EvalSummary:
    """How a run ended.

    Attributes:
        outcomes: All cells of the request, by subject and method.
        machines: Which machine did what.
    """

    outcomes: tuple[Outcome, ...]
    machines: tuple[MachineShare, ...] = ()

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
        """Number of cells by status; ``stale`` are good records that could not be made again."""
        return Counter(outcome.status for outcome in self.outcomes)

    @property
    def all_ok(self) -> bool:
        """Whether every record is good and current."""
        return all(outcome.status == "ok" for outcome in self.outcomes)

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            "counts": dict(self.counts),
            "cached": self.cached,
            "machines": [asdict(machine) for machine in self.machines],
            "records": [record.to_dict() for record in self.records],
            "stale": [
                {
                    "method": kept.record.method_name,
                    "subject": kept.record.subject,
                    "why": kept.kept,
                }
                for kept in self.outcomes
                if kept.kept
            ],
        }


def evaluate(request: EvalRequest, progress: Progress) -> EvalSummary:
    """Carry a request out and return all its records.

    Raises:
        HarnessError: the request itself is wrong (no dataset, or sealed subjects and no reason);
            what goes wrong with one subject is a record instead.
        Interrupted: the run was stopped; cells that were not finished have no new record.
    """
    source = request.source
    source.root()
    if not source.is_imported:
        for method in request.methods:
            require_aligned(method.info, request.protocol)
    require_avatars(source, request.executor)
    methods = tuple(method.row for method in request.methods)
    look = Look(
        "evaluation", source.name, source.subjects, request.reason, methods, source.recipe_name
    )
    admit(source.manifest, source.workspace, look, progress)
    request.store.begin()
    cells = plan(request)
    waiting = {cell.subject for cell in cells if cell.files is None}
    expect_photos(progress, source, len(waiting))
    progress.expect(CELLS, len(cells))
    run = RunOfTasks(request, progress, CellRun(request).given_up)
    tasks = run.tasks_for(cells)
    many = sum(cell.record is None and _is_heavy(cell) for cell in cells) >= _MANY
    # Of a large run, what was planned is more than what has to be kept in memory.
    del cells
    executor = request.executor or Local(request.jobs)
    with serving(wanted=many and request.executor is None):
        executor.carry_out(tasks, progress, run.answered)
    return EvalSummary(run.outcomes(), run.machines())


@dataclass(frozen=True, slots=True)
class CellRun:
    """A request that is being carried out, on this machine.

    Attributes:
        request: What was asked for.
        known: What was found of the subjects that were looked at last.
    """

    request: EvalRequest
    known: KnownFiles = field(default_factory=KnownFiles)

    def photos(self, subject: str, progress: Progress) -> dict[str, object]:
        """A subject's photos are there, with their ``warnings``; or the ``error`` says why not."""
        files = self._files(subject, progress)
        if isinstance(files, HarnessError):
            return {"error": error_values(files)}
        return {"warnings": list(files.capture.warnings)}

    def carried_out(self, row: str, subject: str, progress: Progress) -> dict[str, object]:
        """Reconstruct, score and file a cell, unless its record is current.

        Returns:
            ``cached``, ``kept`` and ``line`` of its ``Outcome``; the line is empty where it is ok.
        """
        files = self.known.get(subject) or self._files(subject, progress)
        with self.request.store.cell(row, subject).locked():
            # Planned under the lock: another run may have filed the record meanwhile.
            outcome = self._outcome(self._method(row), files, progress, subject)
        return _answer(outcome)

    def given_up(self, row: str, subject: str, reason: str) -> dict[str, object]:
        """File the failure of a cell that no machine gave an answer about.

        A record that is current or good stays. Returns as ``carried_out``.
        """
        alone = replace(
            self.request, source=self.request.source.only(subject), methods=(self._method(row),)
        )
        with self.request.store.cell(row, subject).locked():
            (cell,) = plan(alone)
            if cell.record is not None:
                return _answer(Outcome(cell.record, cached=True))
            failure = CellResult("failed", reason, by_method=False)
            return _answer(self._filed(cell, failure, cell.folder.new_attempt()))

    def _method(self, row: str) -> ChosenMethod:
        return next(method for method in self.request.methods if method.row == row)

    def _files(self, subject: str, progress: Progress) -> SubjectFiles | HarnessError:
        """Photos, made if need be, and scan; or why they are not there."""
        source = self.request.source
        files: SubjectFiles | HarnessError
        try:
            capture = photograph(source, subject, progress, self.request.timeout_s)
            files = SubjectFiles(capture, source.scan_of(subject))
        except HarnessError as error:
            files = error
        self.known.put(subject, files)
        return files

    def _outcome(
        self,
        method: ChosenMethod,
        files: SubjectFiles | HarnessError,
        progress: Progress,
        subject: str,
    ) -> Outcome:
        """The record of a cell as it is, or the outcome of reconstructing."""
        cell, reason = self.request.waiting_cell(method, subject, ""), ""
        for _ in range(_ATTEMPTS):
            if isinstance(files, HarnessError):
                waiting = self.request.waiting_cell(method, subject, str(files))
                failure = _failure(files, by_method=False)
                return self._filed(waiting, failure, waiting.folder.new_attempt())
            cell = self.request.cell(method, files)
            if cell.record is not None:
                return Outcome(cell.record, cached=True)
            attempt = cell.folder.new_attempt()
            result = self._result(cell, attempt)
            if result.status != "changed":
                return self._filed(cell, result, attempt)
            reason = result.reason
            progress.say(f"{method.row} on {subject} is planned again: {reason}")
            files = self._files(subject, progress)
        given_up = CellResult("failed", f"after {_ATTEMPTS} attempts, {reason}", by_method=False)
        # Which photos the last attempt saw is not known.
        return self._filed(replace(cell, files=None), given_up, cell.folder.new_attempt())

    def _result(self, cell: Cell, attempt: Attempt) -> CellResult:
        """What a worker made of a planned cell."""
        assert cell.inputs is not None
        request = self.request
        job = CellJob(
            source=request.source.only(cell.subject),
            method=cell.method.ref,
            protocol=request.protocol.name,
            seed=request.seed,
            inputs=cell.inputs,
            folder=attempt.results,
            keep=request.keep,
            share=request.share,
        )
        try:
            worker = ForkedWorker(_WORKER) if _is_heavy(cell) else _WORKER
            values = run_worker(worker, job, log=attempt.log, timeout_s=request.timeout_s)
        except WorkerDied as error:
            # Memory may have run out because of others, and a person may have killed it.
            return _failure(error, by_method=error.by_signal != signal.SIGKILL)
        except HarnessError as error:
            return _failure(error, by_method=False)
        return from_json(CellResult, values, "the worker's answer", "a cell's result")

    def _filed(self, cell: Cell, result: CellResult, attempt: Attempt) -> Outcome:
        record = _record(self.request, cell, result)
        return cell.folder.file(record, attempt, own_failure=result.by_method)


def _is_heavy(cell: Cell) -> bool:
    """Whether a cell's code may import what takes seconds."""
    return cell.inputs is None or "torch" in cell.inputs.packages


def _answer(outcome: Outcome) -> dict[str, object]:
    line = "" if outcome.status == "ok" else outcome.line
    return {"cached": outcome.cached, "kept": outcome.kept, "line": line}


def _failure(error: HarnessError, *, by_method: bool) -> CellResult:
    status = "missing" if isinstance(error, MissingPart) else "failed"
    return CellResult(status, str(error), by_method=by_method)


def _record(request: EvalRequest, cell: Cell, result: CellResult) -> Record:
    assert result.status != "changed"
    capture = cell.files.capture if cell.files else None
    source = request.source

    def told(message: str) -> str:
        return named_from(source.workspace.within(message), source.root().parent)

    return Record(
        key=cell.key,
        method=cell.info,
        dataset=request.source.name,
        subject=cell.subject,
        recipe=request.source.recipe_name,
        protocol=ProtocolStamp.of(request.protocol),
        capture=_stamp(capture) if capture else CaptureStamp(),
        seed=request.seed,
        status=result.status,
        reason=told(result.reason),
        metrics=result.scores.metrics,
        regions=result.scores.regions,
        normal_maps=result.scores.normal_maps,
        warnings=tuple(map(told, result.scores.warnings)),
        diagnostics=result.scores.diagnostics,
        stages=result.stages,
        shared_work=result.shared_work,
        details={**result.details, **_where(result)},
        environment=result.environment or environment(),
        created_utc=utc_now(),
        scale_rule=request.source.scale_rule,
        identity=request.source.identity_of(cell.subject),
        inputs=cell.inputs.to_dict() if cell.inputs else {},
        files=result.files,
    )


def _where(result: CellResult) -> dict[str, object]:
    """The machine that a method ran on; nothing where none was run."""
    return {"machine": machine_facts().to_dict()} if result.environment else {}


def _stamp(capture: Capture) -> CaptureStamp:
    return CaptureStamp(capture.key, len(capture.cameras), capture.warnings)


_lock = threading.Lock()
#: The run that this process works on, by its id; another one takes its place.
_current: dict[str, CellRun] = {}


def photos(job: SubjectJob, before: object, progress: Progress) -> dict[str, object]:
    """The photos of a subject, made if need be: ``warnings``, or the ``error`` instead."""
    del before
    return _run(job).photos(job.subject, progress)


def cell(
    job: SubjectJob, before: Mapping[str, Any] | None, progress: Progress
) -> dict[str, object]:
    """A method on a subject; the record is filed, and the answer is ``CellRun.carried_out``'s."""
    run = _run(job)
    if before and "error" in before:
        run.known.put(job.subject, found_error(before["error"]))
    return run.carried_out(job.row, job.subject, progress)


def _run(job: SubjectJob) -> CellRun:
    """The run, with the methods that a task names.

    Of a run with many methods, a worker resolves those alone that it is asked for.
    """
    with _lock:
        if job.run not in _current:
            made = CellRun(replace(job.request, methods=()).found())
            _current.clear()
            _current[job.run] = made
        run = _current[job.run]
    return replace(run, request=job.request.found())
