"""The run matrix: which cells there are, which are cached, which have to run, and why."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from harness.core.artifacts import Capture, Scan
from harness.core.errors import DataError
from harness.core.process.source_digest import SourceDigest, listed_differences
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import Record
from harness.core.settings import MetricProtocol
from harness.run.method_choice import ChosenMethod, MethodRef
from harness.run.record_inputs import Inputs, evaluated, method_code
from harness.run.sources import Source
from harness.run.store import CellFolder, RunStore
from harness.run.task import Executor
from harness.run.view_choice import as_given

#: ``read(module, privileges)``, as ``method_code``.
ReadCode = Callable[[str, tuple[Privilege, ...]], SourceDigest]


@dataclass(frozen=True, slots=True, eq=False)
class SubjectFiles:
    """What a subject's records are made from, as it lies on disk.

    Attributes:
        capture: Its photos.
        scan: Its true surface; None for imported photos, which have none.
    """

    capture: Capture
    scan: Scan | None


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """One method on one subject: what is known of it when it is planned.

    Attributes:
        method: The method with its settings.
        subject: The subject's id.
        info: What the method said of itself at that moment.
        folder: Where its results lie.
        why: Why it has to run, or what it waits for; empty where the record is current.
        files: Photos and scan; None while they are not there.
        inputs: What its record is made from; None while the files are not there.
        record: Its record, where that is current.
    """

    method: ChosenMethod
    subject: str
    info: MethodInfo
    folder: CellFolder
    why: str
    files: SubjectFiles | None = None
    inputs: Inputs | None = None
    record: Record | None = None

    @property
    def key(self) -> str:
        """Content id of the inputs; empty while the files are not there."""
        return self.inputs.key if self.inputs else ""

    @property
    def state(self) -> Literal["cached", "run"]:
        """Whether the record is current, or the cell has to run."""
        return "run" if self.record is None else "cached"

    def to_dict(self) -> dict[str, str]:
        """Plain JSON values for a reader of the plan."""
        return {
            "method": self.method.row,
            "subject": self.subject,
            "key": self.key,
            "state": self.state,
            "why": self.why,
        }


@dataclass(frozen=True, slots=True, eq=False)
class EvalRequest:
    """What ``harness eval`` was asked for, with all names resolved.

    Attributes:
        source: Subjects and their photos.
        methods: The methods with their settings.
        protocol: How meshes become numbers.
        store: Where records go.
        seed: Root of all randomness.
        jobs: Subjects processed in parallel.
        keep: Whether intermediate results are kept beside the mesh.
        reason: Why sealed subjects are evaluated; needed for sealed subjects only.
        timeout_s: Longest time for the photos of a subject, and for a cell; None is no limit.
        share: Whether methods share what they make alike, such as a body fit.
        executor: Where it is carried out; None is this machine, with ``jobs``.
    """

    source: Source
    methods: tuple[ChosenMethod, ...]
    protocol: MetricProtocol
    store: RunStore
    seed: int = 0
    jobs: int = 1
    keep: bool = False
    reason: str = ""
    timeout_s: float | None = 3600.0
    share: bool = True
    executor: Executor | None = None

    def job(self, methods: Sequence[ChosenMethod]) -> RequestJob:
        """The request with some of its methods, as it travels to other machines."""
        return RequestJob(
            source=self.source,
            methods=tuple(method.ref for method in methods),
            protocol=self.protocol.name,
            store=self.store.directory.resolve(),
            seed=self.seed,
            keep=self.keep,
            timeout_s=self.timeout_s,
            share=self.share,
        )

    def cell(self, method: ChosenMethod, files: SubjectFiles, read: ReadCode = method_code) -> Cell:
        """The cell of a method on a subject whose photos and scan are there.

        Args:
            method: The method.
            files: Its photos and scan.
            read: Gives the code of a module; ``method_code`` reads it from disk each time.

        Raises:
            HarnessError: a part of the method is gone, or its source code is missing.
        """
        info, subject = as_given(method.info, files.capture), files.capture.subject
        code = read(method.module, info.privileges)
        inputs = evaluated(info, code, files.capture, files.scan, self.protocol, self.seed)
        folder = self.store.cell(method.row, subject)
        record: Record | None = None
        try:
            record = folder.record()
            why = _why_not_current(record, inputs)
        except DataError as error:
            why = f"its record is unreadable: {error.what}"
        current = None if why else record
        return Cell(method, subject, info, folder, why, files, inputs, current)

    def waiting_cell(self, method: ChosenMethod, subject: str, why: str) -> Cell:
        """The cell of a method on a subject whose photos or scan are not there."""
        folder = self.store.cell(method.row, subject)
        return Cell(method, subject, method.info, folder, why)


@dataclass(frozen=True, slots=True)
class RequestJob:
    """An ``EvalRequest`` by names, from which another machine makes the same one."""

    source: Source
    methods: tuple[MethodRef, ...]
    protocol: str
    store: Path
    seed: int
    keep: bool
    timeout_s: float | None
    share: bool

    def found(self) -> EvalRequest:
        """The request, with names resolved in this process.

        Raises:
            HarnessError: the manifest is not here, or names in it or in the catalogue are not.
            MissingPart: a method, or one of its parts, is not installed here.
        """
        return EvalRequest(
            source=self.source,
            methods=tuple(method.found(self.source.workspace) for method in self.methods),
            protocol=self.source.manifest.protocol(self.protocol),
            store=RunStore(self.store),
            seed=self.seed,
            keep=self.keep,
            timeout_s=self.timeout_s,
            share=self.share,
        )


@dataclass(frozen=True, slots=True)
class SubjectJob:
    """A task of a run: a subject's photos, or one of its cells.

    Attributes:
        run: Id of the run, whose request is resolved once a process.
        request: The request, with the cell's method alone.
        subject: The subject's id.
        row: The cell's row; empty for photos.
    """

    run: str
    request: RequestJob
    subject: str
    row: str = ""


def _why_not_current(record: Record | None, inputs: Inputs) -> str:
    if record is None:
        return "no record yet"
    failure = f"{record.status} before: {record.reason}"
    if not record.inputs:
        return failure if record.reason else "its record has the form of an earlier version"
    if record.key != inputs.key:
        return f"changed: {listed_differences(record.inputs, inputs.to_dict())}"
    return "" if record.status == "ok" else failure


def plan(request: EvalRequest) -> list[Cell]:
    """All cells of a request, by subject and then by method, without doing any work.

    A subject whose scan cannot be read has cells, too, which say so.

    Raises:
        HarnessError: as ``EvalRequest.cell``.
    """
    # Once for all subjects. A cell that has to run is planned again before it does, and its worker
    # reads the code once more.
    read = functools.cache(method_code)
    return [cell for subject in request.source.subjects for cell in _cells(request, subject, read)]


def _cells(request: EvalRequest, subject: str, read: ReadCode) -> list[Cell]:
    source = request.source
    try:
        state, why = source.capture_state(subject)
        if state == "cached":
            capture = Capture.load(source.capture_directory(subject))
            files = SubjectFiles(capture, source.scan_of(subject))
            return [request.cell(method, files, read) for method in request.methods]
        waits_for = f"photos {state}: {why}"
    except DataError as error:
        waits_for = str(error)
    return [request.waiting_cell(method, subject, waits_for) for method in request.methods]
