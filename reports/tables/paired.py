"""The paired table: how each method differs from one of them, subject by subject.

Means of two methods share their subjects: a hard subject is hard for both, so that intervals of the
means overlap long after the difference is certain. What one method costs or gains is the mean of
the differences, and whether it is more than chance is asked of their signs.

A method may also be compared with itself, as other records have it: with another network, say, or
by an earlier version.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import fmean

from harness.core.errors import HarnessError
from harness.core.metric_catalog import METRICS
from harness.core.records import Record
from harness.core.units import Unit
from reports.statistics import sign_flip_p_value
from reports.tables.geometry import GEOMETRY_METRICS, metric_column, metric_value
from reports.tables.selection import EVERYTHING, Asked, Group, Selection, check_comparable, select
from reports.tables.table import Cell, Column, Interval, Row, Table, mean_cell

#: A difference with a p-value above this may be chance.
LEVEL = 0.05
_NOT_PRINTED = (
    "The paper prints no paired differences; 'harness report --table published --paired' has those "
    "of the authors' results by subject"
)


def paired_table(records: Sequence[Record], asked: Asked = EVERYTHING) -> Table:
    """Each method minus the first, mean over the subjects that both have: a pure function.

    Args:
        records: Records of one run.
        asked: The first method that may be ranked is compared against; intervals are of the mean
            differences.

    Raises:
        HarnessError, ProtocolMismatch: as ``geometry_table``.
    """
    selection = select(records, asked.methods, asked.subjects)
    ranked = [group for group in selection.groups if group.competes]
    title = f"Difference from {ranked[0].title}" if ranked else "Differences"
    pairs = [(group, ranked[0]) for group in ranked[1:]]
    remarks = [_NOT_PRINTED] if asked.published else []
    return _table(selection, pairs, title, asked.interval, remarks)


def change_table(
    records: Sequence[Record],
    before: Sequence[Record],
    asked: Asked = EVERYTHING,
) -> Table:
    """Each method minus itself in other records, mean over the subjects that both have.

    Args:
        records: Records of one run.
        before: Those of another, of the same photos and by the same metric protocol; methods that
            it does not have are left out, and a remark names them.
        asked: Methods are by default all that both have; intervals are of the mean differences.

    Raises:
        HarnessError, ProtocolMismatch: as ``geometry_table``; also where records of both cannot be
            compared.
    """
    known = {record.method_name for record in before}
    wanted = list(asked.methods or dict.fromkeys(record.method_name for record in records))
    both = [name for name in wanted if name in known]
    if not both:
        raise HarnessError(
            "the records before have none of these methods",
            expected=", ".join(wanted),
            got=", ".join(sorted(known)) or "no record",
        )
    selection = select(records, both, asked.subjects)
    earlier = select(before, both, selection.subjects)
    check_comparable(
        [each for of in (selection, earlier) for group in of.groups for each in group.ok]
    )
    # Both have the methods in one order.
    pairs = [
        (group, replace(other, title=f"{group.title}, before"))
        for group, other in zip(selection.groups, earlier.groups, strict=True)
    ]
    without = [name for name in wanted if name not in known]
    remarks = [
        *([_NOT_PRINTED] if asked.published else []),
        *([f"Not in the records before: {', '.join(without)}"] if without else []),
    ]
    return _table(
        selection, pairs, "Difference from the same method before", asked.interval, remarks
    )


def _table(
    selection: Selection,
    pairs: Sequence[tuple[Group, Group]],
    title: str,
    interval: Interval | None,
    remarks: Sequence[str],
) -> Table:
    """The table of each group minus the other of its pair."""
    found = {group.method: _differences(group, reference) for group, reference in pairs}
    p_values = _adjusted(
        {
            (method, metric): sign_flip_p_value(values)
            for method, differences in found.items()
            for metric, values in differences.items()
        }
    )
    rows = [
        _row(pair, len(selection.subjects), found[pair[0].method], p_values, interval)
        for pair in pairs
        if found[pair[0].method]
    ]
    return selection.table(
        name="paired",
        title=title,
        columns=(column for name in GEOMETRY_METRICS for column in _columns(name)),
        more=tuple(_p_column(name) for name in GEOMETRY_METRICS),
        rows=rows,
        remarks=(
            *selection.remarks,
            *remarks,
            *(_reading(rows) if rows else ["No two methods have numbers on one subject"]),
        ),
    )


def _differences(group: Group, reference: Group) -> Mapping[str, list[float]]:
    """By metric, one difference for each subject that both have; empty if there is none."""
    theirs = {record.subject: record for record in reference.ok}
    pairs = [(record, theirs[record.subject]) for record in group.ok if record.subject in theirs]
    if not pairs:
        return {}
    return {
        metric: [metric_value(ours, metric) - metric_value(base, metric) for ours, base in pairs]
        for metric in GEOMETRY_METRICS
    }


def _adjusted(p_values: Mapping[tuple[str, str], float]) -> dict[tuple[str, str], float]:
    """Holm's step-down (1979): the chance that any of the claims up to this one is wrong."""
    adjusted: dict[tuple[str, str], float] = {}
    largest = 0.0
    for rank, cell in enumerate(sorted(p_values, key=lambda cell: p_values[cell])):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[cell]))
        adjusted[cell] = largest
    return adjusted


def _row(
    pair: tuple[Group, Group],
    of: int,
    differences: Mapping[str, list[float]],
    p_values: Mapping[tuple[str, str], float],
    interval: Interval | None,
) -> Row:
    group, reference = pair
    cells: dict[str, Cell] = {}
    for metric, values in differences.items():
        cells[metric] = mean_cell(values, interval)
        cells[f"{metric}_lower_on"] = Cell(100 * fmean(value < 0 for value in values))
        cells[f"{metric}_p"] = Cell(p_values[group.method, metric])
    count = len(differences[GEOMETRY_METRICS[0]])
    return Row(
        method=group.method,
        title=group.title,
        n=count,
        of=of,
        cells=cells,
        # A line of CSV has no caption to say it.
        notes=(f"Minus {reference.title}", *group.notes, *_other_notes(group, reference)),
        privileges=group.privileges,
    )


def _other_notes(group: Group, reference: Group) -> list[str]:
    """What is true of the same method before, and not of it now."""
    if group.method != reference.method:
        return []
    return [f"Before: {note}" for note in reference.notes if note not in group.notes]


def _columns(metric: str) -> tuple[Column, Column]:
    signed = metric_column(metric, ranked=False)
    return signed, Column(
        id=f"{metric}_lower_on",
        title="lower on",
        latex_title="lower on",
        unit=Unit.percent.value,
        digits=0,
        ranked=False,
    )


def _p_column(metric: str) -> Column:
    title = f"{METRICS[metric].title}, p"
    return Column(f"{metric}_p", title, title, Unit.none.value, 4, ranked=False)


def _reading(rows: Sequence[Row]) -> list[str]:
    """How to read the table, and which of its differences may be chance."""
    doubtful = "; ".join(filter(None, map(_doubtful, rows)))
    return [
        "Means of the differences on the subjects that both have, negative is better; lower on: "
        "share of these subjects",
        f"Two-sided sign-flip test over subjects, Holm over all cells, {100 * LEVEL:g} %. May be "
        f"chance: {doubtful or 'none'}",
    ]


def _doubtful(row: Row) -> str:
    p_values = {metric: row.cells[f"{metric}_p"].value for metric in GEOMETRY_METRICS}
    named = ", ".join(
        f"{METRICS[metric].title} p {value:.2g}"
        for metric, value in p_values.items()
        if value > LEVEL
    )
    return f"{row.title} ({named})" if named else ""
