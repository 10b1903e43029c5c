"""Where results lie in a submission and on a board: the same in both.

``<method>/<version>/<subject>.json`` is the record, ``<method>/<version>/<subject>.ply`` its mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.names import checked_name, is_name
from harness.core.records import Record


@dataclass(frozen=True, slots=True)
class Entry:
    """The results of one version of a method.

    Attributes:
        root: The submission or the board.
        method: Its name.
        version: Whatever its authors call this version, such as ``1.0``.
    """

    root: Path
    method: str
    version: str

    @property
    def directory(self) -> Path:
        """Where its files lie."""
        method = checked_name("method", self.method)
        return self.root / method / checked_name("version", self.version)

    @property
    def title(self) -> str:
        """Method and version, as in paths."""
        return f"{self.method}/{self.version}"

    def subjects(self) -> tuple[str, ...]:
        """The subjects that have a record, sorted."""
        return tuple(sorted(path.stem for path in self.directory.glob("*.json")))

    def record_path(self, subject: str) -> Path:
        """The file of a subject's record."""
        return self.directory / f"{checked_name('subject', subject)}.json"

    def mesh_path(self, subject: str) -> Path:
        """The file of a subject's mesh."""
        return self.directory / f"{checked_name('subject', subject)}.ply"

    def links(self, subject: str) -> tuple[str, ...]:
        """What of a subject's record, mesh and folders is a link to something else, by its path."""
        folder = self.directory
        places = (folder.parent, folder, self.record_path(subject), self.mesh_path(subject))
        return tuple(str(path.relative_to(self.root)) for path in places if path.is_symlink())

    def record(self, subject: str) -> Record:
        """A subject's record.

        Raises:
            DataError: it cannot be read, or is of another method or subject than its path says.
        """
        path = self.record_path(subject)
        record = Record.load(path)
        if (record.method_name, record.subject) != (self.method, subject):
            raise DataError(
                f"{path} is in the place of another record",
                expected=f"{self.method} on {subject}",
                got=f"{record.method_name} on {record.subject}",
            )
        return record


def entries_in(root: Path, methods: Sequence[str] = ()) -> tuple[Entry, ...]:
    """All entries of a submission or a board, by path; of some methods, where any are named.

    Raises:
        HarnessError: there is none, or none of a method that is named.
    """
    found = sorted(
        {path.parent for path in root.glob("*/*/*.json")},
        key=lambda path: path.relative_to(root).as_posix(),
    )
    entries = tuple(
        Entry(root, path.parent.name, path.name)
        for path in found
        if is_name(path.parent.name) and is_name(path.name)
        if not methods or path.parent.name in methods
    )
    absent = sorted(set(methods) - {entry.method for entry in entries})
    if entries and absent:
        known = {path.parent.name for path in found}
        raise HarnessError(
            f"there are no results of '{absent[0]}' in {root}", hint=did_you_mean(absent[0], known)
        )
    if not entries:
        raise HarnessError(
            f"there are no results in {root}",
            expected="<method>/<version>/<subject>.json",
            hint="Write them with 'harness results export'",
        )
    return entries
