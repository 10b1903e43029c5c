"""Whether figures without a scan tell what the scan tells: their rank correlation with the errors.

Spearman's coefficient, signed so that 1 means: what looks better without the scan is better with
it. Three questions are asked, because a figure may answer one and not another: over all
reconstructions at once; among the methods on one subject, as when a method is chosen; and among the
subjects of one method, as when one's own results are judged.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np

from harness.core.arrays import Floats
from harness.core.quality.photo_scores import PhotoScores
from harness.core.records import Record
from reports.tables.photos import FIGURES, Figure
from reports.tables.selection import select
from reports.tables.table import Cell, Column, Interval, Row, Table

#: Fewer values than these are not ranked.
LEAST_RANKED = 4
_ERRORS = {"chamfer": "Chamfer", "normal_error": "Normal"}
_GROUPINGS: Mapping[str, tuple[str, Callable[[Record], str]]] = {
    "all": ("all", lambda _: ""),
    "methods": ("methods of a subject", lambda record: record.subject),
    "subjects": ("subjects of a method", lambda record: record.method_name),
}
#: A figure that is the same almost everywhere has no ranks, and is not a quality by degrees.
_RANKED = tuple(figure for figure in FIGURES if figure.id not in ("watertight", "seen"))


@dataclass(frozen=True, slots=True)
class _Pair:
    """A record with its figures."""

    record: Record
    scores: PhotoScores


def photo_errors_table(
    records: Sequence[Record],
    scores: Mapping[tuple[str, str], PhotoScores],
    absent: Mapping[tuple[str, str], str],  # noqa: ARG001
    *,
    methods: Sequence[str] | None = None,
    interval: Interval | None = None,  # noqa: ARG001
) -> Table:
    """The rank correlation of each figure with the errors that the scan gives.

    Methods that are given the truth do not count. Arguments and errors are those of
    ``photos_table``; a coefficient has no interval.
    """
    selection = select(records, methods)
    pairs = [
        _Pair(record, scores[group.method, record.subject])
        for group in selection.groups
        if group.competes
        for record in group.ok
        if (group.method, record.subject) in scores and _ERRORS.keys() <= record.metrics.keys()
    ]
    rows = [_row(figure, pairs, len(selection.subjects)) for figure in _RANKED]
    used = len({pair.record.method_name for pair in pairs})
    return selection.table(
        name="photo-errors",
        title="Rank correlation of figures without a scan with the errors of the mesh",
        columns=(_column(error, grouping) for error in _ERRORS for grouping in _GROUPINGS),
        rows=(row for row in rows if row.cells),
        remarks=(
            f"{len(pairs)} reconstructions of {used} methods",
            "Spearman's coefficient: 1 where what looks better without the scan is better with it, "
            "0 where it says nothing. All: over all reconstructions; methods of a subject, and "
            "subjects of a method: mean over the subjects or methods with at least "
            f"{LEAST_RANKED} values",
            *selection.remarks,
        ),
    )


def _column(error: str, grouping: str) -> Column:
    title = f"{_ERRORS[error]}, {_GROUPINGS[grouping][0]}"
    return Column(f"{error}_{grouping}", title, title, "1", 2, ranked=False)


def _row(figure: Figure, pairs: Sequence[_Pair], of: int) -> Row:
    told = [pair for pair in pairs if figure.read(pair.scores) is not None]
    cells: dict[str, Cell] = {}
    for error in _ERRORS:
        for grouping, (_, group_of) in _GROUPINGS.items():
            found = _mean_correlation(figure, told, error, group_of)
            if found is not None:
                cells[f"{error}_{grouping}"] = Cell(found)
    subjects = len({pair.record.subject for pair in told})
    return Row(figure.id, figure.title, subjects, of, cells, competes=False)


def _mean_correlation(
    figure: Figure, pairs: Sequence[_Pair], error: str, group_of: Callable[[Record], str]
) -> float | None:
    groups: dict[str, list[_Pair]] = {}
    for pair in pairs:
        groups.setdefault(group_of(pair.record), []).append(pair)
    sign = -1.0 if figure.higher_is_better else 1.0
    found: list[float] = []
    for group in groups.values():
        values = np.array([figure.read(pair.scores) for pair in group], dtype=np.float64)
        errors = np.array([pair.record.metrics[error].value for pair in group])
        coefficient = rank_correlation(values, errors)
        if coefficient is not None:
            found.append(sign * coefficient)
    return fmean(found) if found else None


def rank_correlation(first: Floats, second: Floats) -> float | None:
    """Spearman's coefficient of (N,) values; None for few values, or where all are equal.

    Values that are equal share the mean of their ranks.
    """
    from scipy.stats import rankdata

    if len(first) < LEAST_RANKED or np.ptp(first) == 0 or np.ptp(second) == 0:
        return None
    return float(np.corrcoef(rankdata(first), rankdata(second))[0, 1])
