"""The record store: one folder per cell (method x subject), one ``record.json`` in each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import HarnessError, did_you_mean
from harness.core.files import exclusive_lock, remove_leftovers, write_json
from harness.core.names import checked_name
from harness.core.records import Record
from harness.pipeline.workspace import Workspace

__all__ = ["RunStore"]

_RUN_FILE = "run.json"
_CELL_FILES = ("record.json", "mesh.ply", "body.npz", "normals.npz")


@dataclass(frozen=True, slots=True)
class RunStore:
    """The records of one run.

    Attributes:
        directory: ``runs/<name>``.
    """

    directory: Path

    def begin(self) -> None:
        """Make the run's folder if it is not there; the run becomes the last one."""
        write_json(self.directory / _RUN_FILE, {"schema": 1, "name": self.directory.name})

    @classmethod
    def existing(cls, workspace: Workspace, name: str | None) -> RunStore:
        """A run by name, or the one last written to.

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
            name = max(marks, key=lambda run: marks[run].stat().st_mtime)
        if name not in marks:
            raise HarnessError(
                f"no run '{name}' below {workspace.runs}", hint=did_you_mean(name, marks)
            )
        return cls(workspace.run(name))

    def cell(self, method: str, subject: str) -> Path:
        """Folder of one cell."""
        return self.directory / checked_name("method", method) / checked_name("subject", subject)

    def record(self, method: str, subject: str) -> Record | None:
        """The record of one cell, or None where there is none yet."""
        path = self.cell(method, subject) / "record.json"
        return Record.load(path) if path.is_file() else None

    def records(self) -> list[Record]:
        """All records, by method and subject.

        Raises:
            DataError: a record that cannot be read; it is never skipped.
        """
        return [Record.load(path) for path in sorted(self.directory.glob("*/*/record.json"))]

    @contextmanager
    def locked(self, method: str, subject: str) -> Iterator[None]:
        """Hold one cell, so that two runs at once do not do the same work or mix their files."""
        cell = self.cell(method, subject)
        with exclusive_lock(cell / ".lock"):
            for name in _CELL_FILES:
                remove_leftovers(cell / name)
            yield
