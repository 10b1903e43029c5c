"""``harness results page``: a board becomes a leaderboard that opens from its files.

Results of different datasets, recipes or metric protocols never meet in a table: each kind has
tables of its own. The first ones show the last version of each method, and more show all versions.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.board.entries import Results, entries_in
from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.records import Record
from reports.page.folder import page_folder
from reports.page.model import BoardModel, Fact, page_methods
from reports.statistics import bootstrap_ends
from reports.tables.cost import cost_table
from reports.tables.geometry import geometry_table
from reports.tables.regions import regions_table
from reports.tables.selection import Asked, check_comparable, check_one_method
from reports.tables.table import Table

#: Fewer subjects tell next to nothing of their spread.
_LEAST_FOR_INTERVALS, _MOST_LISTED = 4, 20
_TABLES: tuple[Callable[..., Table], ...] = (geometry_table, regions_table, cost_table)


@dataclass(frozen=True, slots=True)
class _Standing:
    """The records of one entry that can be shown; their methods carry the version in their names.

    Attributes:
        results: What was read.
        records: Named as ``hull8/1.0``.
    """

    results: Results
    records: tuple[Record, ...]


def write_board_page(
    board: Path, directory: Path, title: str, tell: Callable[[str], None] = lambda _: None
) -> Path:
    """The ``index.html`` of a leaderboard, written now.

    What cannot be read or cannot stand in one table is left out, and the page lists it.

    Args:
        board: Results as ``<method>/<version>/<subject>.json``.
        directory: The folder to write; an older page there is replaced.
        title: The heading.
        tell: Hears what is left out, one line each.

    Raises:
        HarnessError: a board without results that can be shown, or a folder that holds something
            else.
    """
    standings: list[_Standing] = []
    left_out: list[str] = []
    for entry in entries_in(board):
        results = entry.read()
        left_out += [f"{entry.title}, {each}: {why}" for each, why in results.left_out.items()]
        try:
            standings += _standing(results)
        except ProtocolMismatch as error:
            left_out.append(f"{entry.title}: {error}")
    for line in left_out:
        tell(f"left out: {line}")
    if not standings:
        raise HarnessError(f"there are no results in {board} that can be shown", got=left_out[0])
    groups = _comparable(standings)
    records = tuple(record for group in groups for record in _records(group))
    methods = tuple(method for group in groups for method in page_methods(_records(group)))
    # Subjects that some method of the same kind has, for what was not run.
    subjects = tuple(sorted({record.subject for record in records})) if len(groups) == 1 else ()
    model = BoardModel(
        title=title,
        lead=_lead(standings),
        facts=(*_facts(records), *([Fact("Left out", _first(left_out))] if left_out else [])),
        tables=_tables(groups),
        methods=methods,
        records=records,
        subjects=subjects,
    )
    with page_folder(directory) as folder:
        for standing in standings:
            for shown in standing.records:
                folder.add_record(shown, standing.results.records[shown.subject])
        folder.finish_board(model)
    return directory / "index.html"


def _standing(results: Results) -> list[_Standing]:
    """An entry's records under its name; none if it has none.

    Raises:
        ProtocolMismatch: they cannot stand in one table.
    """
    entry, found = results.entry, results.records.values()
    check_comparable(list(found))
    check_one_method([record for record in found if record.status == "ok"])
    records = tuple(
        replace(
            record,
            method=replace(
                record.method,
                name=entry.title,
                title=f"{record.method.title} ({entry.version})",
            ),
        )
        for record in found
    )
    return [_Standing(results, records)] if records else []


def _first(lines: Sequence[str]) -> str:
    more = len(lines) - _MOST_LISTED
    return "; ".join(lines[:_MOST_LISTED]) + (f"; and {more} more" if more > 0 else "")


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
            groups.append([standing])
    return groups


def _tables(groups: Sequence[Sequence[_Standing]]) -> tuple[Table, ...]:
    found: list[Table] = []
    for number, group in enumerate(groups, start=1):
        ordered = sorted(group, key=lambda standing: standing.results.made)
        last = {standing.results.entry.method: standing for standing in ordered}.values()
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


def _table(make: Callable[..., Table], records: Sequence[Record]) -> Table:
    enough = len({record.subject for record in records}) >= _LEAST_FOR_INTERVALS
    return make(records, Asked(interval=bootstrap_ends if enough else None))


def _lead(standings: Sequence[_Standing]) -> str:
    methods = len({standing.results.entry.method for standing in standings})
    return (
        f"{methods} method{'' if methods == 1 else 's'} in {len(standings)} "
        f"version{'' if len(standings) == 1 else 's'}, whose meshes were handed in and scored."
    )


def _facts(records: Sequence[Record]) -> tuple[Fact, ...]:
    return (
        Fact("Datasets", _listed(record.dataset for record in records)),
        Fact("Photos", _listed(record.recipe or "made elsewhere" for record in records)),
        Fact("Metric protocols", _listed(record.protocol.text for record in records)),
        Fact("Last result (UTC)", max(records, key=lambda record: record.made).created_utc),
    )


def _listed(texts: Iterable[str]) -> str:
    """The different texts, sorted, with semicolons."""
    return "; ".join(sorted(set(texts)))
