"""The table of published numbers alone: means or differences, and the printed table below."""

from collections.abc import Sequence
from dataclasses import replace

from harness.core.errors import HarnessError, did_you_mean
from reports.published.printed import PUBLISHED, STORED_METHODS, SUBJECTS, stored_records
from reports.statistics import percentile_ends
from reports.tables.geometry import geometry_table
from reports.tables.paired import paired_table
from reports.tables.selection import Asked
from reports.tables.table import Row, Table

_ORIGIN = "Results by subject as published with the paper's code, not measured here"
#: The paper's rival first: differences are from it unless others are asked for.
_FROM_RIVAL = ("vggt8", "econ", "mexecon2", "mexecon8")
#: So that any other bootstrap of the same files can be held against the printed ends.
_INTERVALS = "Intervals are plain percentiles; tables of runs correct theirs for bias and skew"
_ROW_NOTE = "Published mm: very likely thousandths of a scan unit"


def published_means(
    *,
    methods: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
    intervals: bool = False,
) -> Table:
    """The mean of each published method over its stored subjects; the printed table stands below.

    Nothing is ranked, because the methods' subjects differ.

    Args:
        methods: Names in ``STORED_METHODS``, in this order; all by default.
        subjects: Subjects that count; the paper's 20 by default.
        intervals: Whether means carry their percentile bootstrap interval.

    Raises:
        HarnessError: an unknown method or subject.
    """
    _check_known("method", methods, tuple(STORED_METHODS))
    _check_known("subject", subjects, SUBJECTS)
    table = geometry_table(
        stored_records(),
        Asked(
            methods=methods,
            subjects=subjects,
            interval=percentile_ends if intervals else None,
            published=True,
        ),
    )
    unranked = tuple(replace(column, ranked=False) for column in table.columns)
    remarks = (_INTERVALS, *table.remarks) if intervals else table.remarks
    return _published(
        replace(table, columns=unranked, remarks=remarks),
        title="Means of the published results",
        heading="Printed in the paper",
    )


def published_differences(
    *,
    methods: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
) -> Table:
    """Each published method minus the first, subject by subject; the printed table stands below.

    Mean differences carry their percentile bootstrap interval.

    Args:
        methods: The first is compared against; by default 8-view VGGT, the paper's rival.
        subjects: Subjects that count; the paper's 20 by default.

    Raises:
        HarnessError: an unknown method or subject, or fewer than two methods.
    """
    _check_known("method", methods, tuple(STORED_METHODS))
    _check_known("subject", subjects, SUBJECTS)
    chosen = methods or _FROM_RIVAL
    if len(set(chosen)) < 2:
        raise HarnessError(
            "differences need two published methods",
            got=", ".join(chosen),
            hint=f"Name two or more of {', '.join(STORED_METHODS)}, or none",
        )
    table = paired_table(
        stored_records(), Asked(methods=chosen, subjects=subjects, interval=percentile_ends)
    )
    return _published(
        replace(table, remarks=(_INTERVALS, _counts(table.rows), *table.remarks)),
        title=f"Published results: {table.title[0].lower()}{table.title[1:]}",
        heading="Printed in the paper: means, not differences",
    )


def _published(table: Table, title: str, heading: str) -> Table:
    """The same table with what is true of published numbers."""
    return replace(
        table,
        name="published",
        title=title,
        origin=_ORIGIN,
        protocol=None,
        rows=tuple(replace(row, notes=(*row.notes, _ROW_NOTE)) for row in table.rows),
        published=replace(PUBLISHED["geometry"], heading=heading),
    )


def _counts(rows: Sequence[Row]) -> str:
    """On how many subjects each row is the better one."""
    counts = (
        f"{row.title} {round(row.cells['chamfer_lower_on'].value * row.n / 100)} of {row.n}"
        for row in rows
    )
    return f"Chamfer is lower on: {', '.join(counts)}"


def _check_known(kind: str, names: Sequence[str] | None, known: Sequence[str]) -> None:
    for name in names or ():
        if name not in known:
            raise HarnessError(f"no published {kind} '{name}'", hint=did_you_mean(name, known))
