"""What an entry has reached: its subjects with numbers, their means, and what came before it."""

from __future__ import annotations

from collections.abc import Collection
from statistics import fmean

from harness.core.files.names import is_name
from harness.pipeline.board.entries import Entry
from reports.tables.geometry import GEOMETRY_METRICS


def versions(board: Entry) -> tuple[Entry, ...]:
    """All versions of an entry's method on its board, the one that was made last at the end."""
    folder = board.directory.parent
    paths = folder.iterdir() if folder.is_dir() else ()
    # A merge that was killed may have left a folder that is no version.
    names = [path.name for path in paths if path.is_dir() and is_name(path.name)]
    found = [Entry(board.root, board.method, name) for name in names]
    return tuple(sorted((entry for entry in found if entry.subjects()), key=made_utc))


def last_version(board: Entry) -> Entry | None:
    """The version of an entry's method that was made last, by its records; None if none was."""
    return next(reversed(versions(board)), None)


def made_utc(entry: Entry) -> str:
    """When its last record was made, ISO 8601."""
    return max(entry.record(subject).created_utc for subject in entry.subjects())


def proven(entry: Entry) -> list[str]:
    """Subjects with numbers."""
    return [subject for subject in entry.subjects() if entry.record(subject).status == "ok"]


def means(entry: Entry, subjects: Collection[str] | None = None) -> dict[str, float]:
    """Means by metric's id over its subjects with numbers; over some of them, where given."""
    records = [
        entry.record(subject)
        for subject in proven(entry)
        if subjects is None or subject in subjects
    ]
    found = {
        name: [record.metrics[name].value for record in records if name in record.metrics]
        for name in GEOMETRY_METRICS
    }
    return {name: fmean(values) for name, values in found.items() if values}
