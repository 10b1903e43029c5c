"""The views table: how the error falls with the number of photos that a method is given."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from harness.core.records import Record
from harness.core.units import Unit
from reports.tables.geometry import GEOMETRY_METRICS, geometry_table
from reports.tables.selection import EVERYTHING, Asked
from reports.tables.table import Cell, Column, Row, Table

_VIEWS = Column("views", "Views", "Views", Unit.none.value, 0, ranked=False)


@dataclass(frozen=True, slots=True)
class ViewPoint:
    """Means over subjects with some number of views.

    Attributes:
        views: How many.
        means: By metric id, with their intervals where they were asked for.
    """

    views: int
    means: dict[str, Cell]


@dataclass(frozen=True, slots=True)
class ViewSeries:
    """One method with different numbers of views, the fewest first."""

    title: str
    points: tuple[ViewPoint, ...]


def views_table(records: Sequence[Record], asked: Asked = EVERYTHING) -> Table:
    """The geometry table with the number of views that each method used, by method and views.

    Rows of one method, which differ in settings, stand together. Arguments and errors are those of
    ``geometry_table``.
    """
    counts = _counts(records)
    every = list(dict.fromkeys(asked.methods or (record.method_name for record in records)))
    # Only rows that are shown say over which subjects they are ranked.
    shown = [name for name in every if name in counts] or every
    table = geometry_table(records, replace(asked, methods=shown))
    known = [row for row in table.rows if row.method in counts]
    families = list(dict.fromkeys(_family(row) for row in known))
    known.sort(key=lambda row: (families.index(_family(row)), counts[row.method]))
    titles = {record.method_name: record.method.title for record in records}
    unknown = [titles.get(name, name) for name in every if name not in counts]
    left_out = [f"How many views were used is not known: {', '.join(unknown)}"] if unknown else []
    return replace(
        table,
        name="views",
        title="Mesh geometry by number of views",
        columns=(_VIEWS, *table.columns),
        rows=tuple(
            replace(row, cells={"views": Cell(counts[row.method]), **row.cells} if row.n else {})
            for row in known
        ),
        remarks=(*table.remarks, *left_out),
    )


def view_series(table: Table) -> tuple[ViewSeries, ...]:
    """The methods of a views table that have numbers with at least two numbers of views."""
    series: dict[str, list[ViewPoint]] = {}
    for row in table.rows:
        if row.n:
            means = {metric: row.cells[metric] for metric in GEOMETRY_METRICS}
            point = ViewPoint(int(row.cells["views"].value), means)
            series.setdefault(_family(row), []).append(point)
    return tuple(
        ViewSeries(title, tuple(points))
        for title, points in series.items()
        if len({point.views for point in points}) > 1
    )


def _counts(records: Sequence[Record]) -> dict[str, int]:
    """Number of views by method, where it is known and the same on all subjects."""
    found: dict[str, set[int | None]] = {}
    for record in records:
        if record.status == "ok":
            found.setdefault(record.method_name, set()).add(record.views_used)
    only = {name: next(iter(counts)) for name, counts in found.items() if len(counts) == 1}
    return {name: count for name, count in only.items() if count is not None}


def _family(row: Row) -> str:
    """What rows of one method with different numbers of views have in common: the title's start."""
    return row.title.partition(",")[0]
