"""A run's cells as tasks, and what came of them."""

from __future__ import annotations

import threading
import uuid
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from harness.core.errors import DataError, HarnessError
from harness.run.plan import Cell, EvalRequest, RequestJob, SubjectFiles, SubjectJob
from harness.run.progress import PhotoSteps, Progress
from harness.run.store import Outcome
from harness.run.task import Answer, Task

#: Name of the progress bar that counts cells.
CELLS = "reconstructions"
_HANDLERS = "harness.run.handlers"

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
