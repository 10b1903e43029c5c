"""``harness results page``: a board becomes a leaderboard that opens from its files.

Results of different datasets, recipes or metric protocols never meet in a table: each kind has
tables of its own. The first ones show the last version of each method, and more show all versions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.core.errors import ProtocolMismatch
from harness.core.records import Record
from harness.pipeline.board.entries import Entry, entries_in
from harness.pipeline.board.standing import made_utc
from reports.page.folder import page_folder
from reports.page.methods import page_methods
from reports.page.model import BoardModel, Fact
from reports.statistics import bootstrap_ends
from reports.tables.cost import cost_table
from reports.tables.geometry import geometry_table
from reports.tables.regions import regions_table
from reports.tables.selection import check_comparable
from reports.tables.table import Table

#: Fewer subjects tell next to nothing of their spread.
_LEAST_FOR_INTERVALS = 4
_TABLES: tuple[Callable[..., Table], ...] = (geometry_table, regions_table, cost_table)


@dataclass(frozen=True, slots=True)
class _Standing:
    """The records of one entry, which carry the version in their method's name.

    Attributes:
        entry: Where they lie.
        records: Named as ``hull8/1.0``.
        made_utc: When the last of them was made.
    """

    entry: Entry
    records: tuple[Record, ...]
    made_utc: str

    @classmethod
    def of(cls, entry: Entry) -> _Standing:
        records = tuple(_named(entry, entry.record(subject)) for subject in entry.subjects())
        return cls(entry, records, made_utc(entry))


def write_board_page(board: Path, directory: Path, title: str) -> Path:
    """The ``index.html`` of a leaderboard, written now.

    Args:
        board: Results as ``<method>/<version>/<subject>.json``.
        directory: The folder to write; an older page there is replaced.
        title: The heading.

    Raises:
        HarnessError: a board without results, or a folder that holds something else.
        DataError: a record that cannot be read or lies in the wrong place.
    """
    standings = [_Standing.of(entry) for entry in entries_in(board)]
    groups = _comparable(standings)
    records = tuple(record for group in groups for record in _records(group))
    methods = tuple(method for group in groups for method in page_methods(_records(group)))
    # Subjects that some method of the same kind has, for what was not run.
    subjects = tuple(sorted({record.subject for record in records})) if len(groups) == 1 else ()
    model = BoardModel(
        title=title,
        lead=_lead(standings),
        facts=_facts(records),
        tables=_tables(groups),
        methods=methods,
        records=records,
        subjects=subjects,
    )
    with page_folder(directory) as folder:
        for standing in standings:
            for shown in standing.records:
                folder.add_record(shown, standing.entry.record(shown.subject))
        folder.finish_board(model)
    return directory / "index.html"


def _named(entry: Entry, record: Record) -> Record:
    info = record.method
    named = replace(info, name=entry.title, title=f"{info.title} ({entry.version})")
    return replace(record, method=named)


def _records(group: Iterable[_Standing]) -> list[Record]:
    return [record for standing in group for record in standing.records]


def _comparable(standings: Sequence[_Standing]) -> list[list[_Standing]]:
    """Entries whose numbers may meet, together."""
    groups: list[list[_Standing]] = []
    for standing in standings:
        for group in groups:
            try:
                check_comparable([*_records(group), *standing.records])
            except ProtocolMismatch:
                continue
            group.append(standing)
            break
        else:
            check_comparable(standing.records)
            groups.append([standing])
    return groups


def _tables(groups: Sequence[Sequence[_Standing]]) -> tuple[Table, ...]:
    found: list[Table] = []
    for number, group in enumerate(groups, start=1):
        last = {standing.entry.method: standing for standing in sorted(group, key=_made)}.values()
        records = _records(last)
        tables = [_table(make, records) for make in _TABLES]
        if len(last) < len(group):
            every = _table(geometry_table, _records(group))
            tables.append(replace(every, name="versions", title="All versions"))
        suffix = f"-{number}" if number > 1 else ""
        what = f"{tables[0].dataset}, {tables[0].recipe or 'photos made elsewhere'}"
        found += [
            replace(
                table,
                name=f"{table.name}{suffix}",
                title=f"{table.title}: {what}" if len(groups) > 1 else table.title,
            )
            for table in tables
            if table.rows
        ]
    return tuple(found)


def _made(standing: _Standing) -> str:
    return standing.made_utc


def _table(make: Callable[..., Table], records: Sequence[Record]) -> Table:
    enough = len({record.subject for record in records}) >= _LEAST_FOR_INTERVALS
    return make(records, interval=bootstrap_ends if enough else None)


def _lead(standings: Sequence[_Standing]) -> str:
    methods = len({standing.entry.method for standing in standings})
    return (
        f"{methods} method{'' if methods == 1 else 's'} in {len(standings)} "
        f"version{'' if len(standings) == 1 else 's'}, whose meshes were handed in and scored."
    )


def _facts(records: Sequence[Record]) -> tuple[Fact, ...]:
    return (
        Fact("Datasets", _listed(record.dataset for record in records)),
        Fact("Photos", _listed(record.recipe or "made elsewhere" for record in records)),
        Fact("Metric protocols", _listed(record.protocol.text for record in records)),
        Fact("Last result (UTC)", max(record.created_utc for record in records)),
    )


def _listed(texts: Iterable[str]) -> str:
    """The different texts, sorted, with semicolons."""
    return "; ".join(sorted(set(texts)))
