"""The record store: one folder per cell (method x subject), one ``record.json`` in each."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.atomic import exclusive_lock, remove_leftovers, write_json
from harness.core.files.hashing import file_sha256
from harness.core.files.names import checked_name
from harness.core.protocols import Privilege
from harness.core.records import Record
from harness.run.publication import Attempt, abandon, collect, file_of, link_results, publish
from harness.run.workspace import Workspace

#: The run that reconstructions of a user's own photos are filed in.
PHOTOS_RUN = "photos"

_RUN_FILE = "run.json"
_RECORD_FILE = "record.json"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What there is of a cell after a run.

    Attributes:
        record: The cell's record.
        cached: Whether the record was there before, and is current.
        kept: Why the record is an older good one that stays though it is not current; else empty.
    """

    record: Record
    cached: bool = False
    kept: str = ""

    @property
    def status(self) -> str:
        """The record's status, or ``stale`` for a record that stays."""
        return "stale" if self.kept else self.record.status

    @property
    def line(self) -> str:
        """One line about a cell that is not ``ok``."""
        cell = f"{self.record.method_name} on {self.record.subject}"
        if self.kept:
            return (
                f"{cell} keeps its good record of {self.record.created_utc}, because it could not "
                f"be made again: {self.kept}"
            )
        return f"{cell} {self.record.status}: {self.record.reason}"


@dataclass(frozen=True, slots=True)
class CellFolder:
    """Where the record and the results of one cell lie.

    Attributes:
        directory: ``runs/<name>/<method>/<subject>``.
    """

    directory: Path

    def record(self) -> Record | None:
        """The cell's record, or None where there is none yet.

        Raises:
            DataError: a record that cannot be read.
        """
        path = self.directory / _RECORD_FILE
        return Record.load(path, *self.directory.parts[-2:]) if path.is_file() else None

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the cell, so that two simultaneous runs do not do the same work or mix their files.

        Raises:
            Interrupted: the run was stopped while it waited.
        """
        with exclusive_lock(self.directory / ".lock"):
            remove_leftovers(self.directory / _RECORD_FILE)
            with contextlib.suppress(DataError):
                found = self.record()
                collect(self.directory, found)
                if found is not None:
                    link_results(self.directory, found)
            try:
                yield
            finally:
                abandon(self.directory)

    def new_attempt(self) -> Attempt:
        """The folder of a fresh attempt at a cell that is held; earlier ones are gone.

        What the cell holds stays untouched until ``file``.
        """
        abandon(self.directory)
        return Attempt.begin(self.directory)

    def file(self, record: Record, attempt: Attempt, *, own_failure: bool = True) -> Outcome:
        """Put a record and the results of an attempt in the place of what the cell holds.

        Args:
            record: The new record of this cell, which is held.
            attempt: What it was made in.
            own_failure: Whether a failure is the method's; one that is not leaves a good record.

        Raises:
            DataError: a full disk or a missing right.
        """
        if record.status != "ok" and not own_failure:
            good = self._good_record()
            if good is not None:
                attempt.keep_log(self.directory)
                return Outcome(good, kept=record.reason)
        return Outcome(publish(self.directory, attempt, record))

    def _good_record(self) -> Record | None:
        try:
            found = self.record()
        except DataError:
            return None
        return found if found is not None and found.status == "ok" else None


@dataclass(frozen=True, slots=True)
class RunStore:
    """The records of one run.

    Attributes:
        directory: ``runs/<name>``.
    """

    directory: Path

    def begin(self) -> None:
        """Make the run's folder if it does not exist; the run becomes the latest."""
        path = self.directory / _RUN_FILE
        with exclusive_lock(self.directory / ".run.lock"):
            remove_leftovers(path)
            write_json(path, {"schema": 1, "name": self.directory.name})

    @classmethod
    def existing(cls, workspace: Workspace, name: str | None) -> RunStore:
        """A run by name, or the one last written to; ``PHOTOS_RUN`` only if there is no other.

        Raises:
            HarnessError: no such run, or no run at all.
        """
        marks = {mark.parent.name: mark for mark in workspace.runs.glob(f"*/{_RUN_FILE}")}
        if name is None:
            if not marks:
                raise HarnessError(
                    f"no run below {workspace.runs}",
                    hint="Make one with 'harness quickstart' or 'harness eval --method hull8'",
                )
            # Nothing in that one is measured, and nobody named it.
            evaluated = {run: mark for run, mark in marks.items() if run != PHOTOS_RUN} or marks
            name = max(evaluated, key=lambda run: evaluated[run].stat().st_mtime)
        if name not in marks:
            raise HarnessError(
                f"no run '{name}' below {workspace.runs}", hint=did_you_mean(name, marks)
            )
        return cls(workspace.run(name))

    def cell(self, method: str, subject: str) -> CellFolder:
        """The folder of one cell."""
        folder = self.directory / checked_name("method", method)
        return CellFolder(folder / checked_name("subject", subject))

    def records(self, whole: Collection[str] = ()) -> list[Record]:
        """All records, by method and subject; ``whole`` as ``Record.from_document`` has it.

        Raises:
            DataError: a record that cannot be read; it is never skipped.
        """
        paths = sorted(self.directory.glob(f"*/*/{_RECORD_FILE}"))
        return [Record.load(path, path.parts[-3], path.parts[-2], whole) for path in paths]

    def result(self, record: Record, name: str) -> Path:
        """The file of a record's result, such as ``mesh.ply``, after a check that it is unchanged.

        Raises:
            DataError: the record has none, or the file is gone or another one.
        """
        path = file_of(self.cell(record.method_name, record.subject).directory, record, name)
        expected = record.files.get(name)
        if expected is None:
            raise DataError(
                f"the record of {record.method_name} on {record.subject} has no {name}",
                hint="Score it again: earlier versions did not keep meshes made elsewhere"
                if Privilege.MADE_ELSEWHERE in record.privileges
                else "Evaluate again: records of earlier versions do not list their files",
            )
        if not path.is_file() or file_sha256(path) != expected:
            raise DataError(
                f"{path} is not what its record measured",
                expected=f"sha256 {expected[:12]}…",
                got=f"{file_sha256(path)[:12]}…" if path.is_file() else "no file",
                hint="Delete the record beside it and evaluate again",
            )
        return path
