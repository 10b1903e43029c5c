"""Where results lie in a submission and on a board, and what they have reached: the same in both.

``<method>/<version>/<subject>.json`` is the record, ``<method>/<version>/<subject>.ply`` its mesh.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import fmean

from harness.core.errors import HarnessError, did_you_mean
from harness.core.files.names import checked_name, is_name
from harness.core.records import Record
from reports.tables.geometry import GEOMETRY_METRICS


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

    def read(self) -> Results:
        """Its records, and why what is no record of it is left out; a link leads elsewhere."""
        records: dict[str, Record] = {}
        left_out: dict[str, str] = {}
        folder = self.directory
        for subject in self.subjects():
            try:
                files = (self.record_path(subject), self.mesh_path(subject))
                links = [path for path in (folder.parent, folder, *files) if path.is_symlink()]
                if links:
                    left_out[subject] = f"{links[0].relative_to(self.root)} is a link, not a file"
                else:
                    records[subject] = Record.load(files[0], self.method, subject)
            except HarnessError as error:
                left_out[subject] = str(error)
        return Results(self, records, left_out)


@dataclass(frozen=True, slots=True)
class Results:
    """What an entry has reached.

    Attributes:
        entry: Whose.
        records: By subject.
        left_out: Why a file is no record of it, as a sentence without a full stop, by subject.
    """

    entry: Entry
    records: Mapping[str, Record]
    left_out: Mapping[str, str]

    @property
    def made(self) -> datetime:
        """When its last record was made."""
        times = (record.made for record in self.records.values())
        return max(times, default=datetime.min.replace(tzinfo=UTC))

    @property
    def proven(self) -> list[str]:
        """Subjects with numbers."""
        return [subject for subject, record in self.records.items() if record.status == "ok"]

    def means(self, subjects: Collection[str] | None = None) -> dict[str, float]:
        """Means by metric's id over its subjects with numbers; over some of them, where given."""
        chosen = [self.records[s] for s in self.proven if subjects is None or s in subjects]
        found = {
            name: [record.metrics[name].value for record in chosen if name in record.metrics]
            for name in GEOMETRY_METRICS
        }
        return {name: fmean(values) for name, values in found.items() if values}


def entries_in(root: Path, methods: Sequence[str] = ()) -> tuple[Entry, ...]:
    """All entries of a submission or a board, by path; of some methods, where any are named.

    Raises:
        HarnessError: there is none, or none of a method that is named.
    """
    found = {(path.parts[-3], path.parts[-2]) for path in root.glob("*/*/*.json")}
    known = {method for method, _ in found}
    absent = sorted(set(methods) - known)
    if found and absent:
        raise HarnessError(
            f"there are no results of '{absent[0]}' in {root}", hint=did_you_mean(absent[0], known)
        )
    entries = tuple(
        Entry(root, method, version)
        for method, version in sorted(found)
        if is_name(method) and is_name(version) and (not methods or method in methods)
    )
    if not entries:
        raise HarnessError(
            f"there are no results in {root}",
            expected="<method>/<version>/<subject>.json",
            hint="Write them with 'harness results export'",
        )
    return entries


def versions(board: Entry) -> tuple[Results, ...]:
    """All versions of an entry's method on its board, the one that was made last at the end."""
    # A merge that was killed may have left a folder that is no version.
    names = {path.parent.name for path in board.directory.parent.glob("*/*.json")}
    found = [Entry(board.root, board.method, name).read() for name in names if is_name(name)]
    return tuple(sorted((each for each in found if each.records), key=lambda each: each.made))
