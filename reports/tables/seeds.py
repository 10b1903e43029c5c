"""The table of several seeds: how far results lie apart when only the seed changes.

Beside each mean stand two standard deviations: of the mean over subjects from seed to seed, and of
the subjects' own values, each averaged over its seeds. A difference between two methods that is
smaller than the first is one of chance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean, stdev

from harness.core.metric_catalog import METRICS
from harness.core.records import Record
from reports.tables.geometry import GEOMETRY_METRICS, metric_column
from reports.tables.selection import (
    Group,
    Selection,
    check_comparable,
    check_one_method,
    select,
)
from reports.tables.table import Cell, Column, Row, Table, with_common_means

_SEEDS = Column("seeds", "Seeds", "Seeds", "", 0, ranked=False)


@dataclass(frozen=True, slots=True)
class _Values:
    """A metric of one method, by seed and then by subject; all seeds have the same subjects."""

    by_seed: tuple[Mapping[str, float], ...]

    @property
    def by_subject(self) -> dict[str, float]:
        """The mean over seeds of each subject."""
        return {
            subject: fmean(values[subject] for values in self.by_seed)
            for subject in self.by_seed[0]
        }

    def cells(self, metric: str) -> dict[str, Cell]:
        """The mean, and the two deviations where there are two values to deviate."""
        subjects = self.by_subject
        found = {metric: Cell(fmean(subjects.values()), by_subject=subjects)}
        if len(self.by_seed) > 1:
            means = [fmean(values.values()) for values in self.by_seed]
            found[f"{metric}_sd_seeds"] = Cell(stdev(means))
        if len(subjects) > 1:
            found[f"{metric}_sd_subjects"] = Cell(stdev(subjects.values()))
        return found


def seeds_table(
    runs: Sequence[Sequence[Record]],
    *,
    methods: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
) -> Table:
    """The geometry of one request under several seeds, as a pure function of its records.

    Args:
        runs: Records by seed. A method that takes no seed has records in the first alone.
        methods: Rows wanted, in this order; all by default.
        subjects: Subjects that count; all of the records' by default.

    Raises:
        HarnessError: no records, or two for one method, subject and seed.
        ProtocolMismatch: records that are not comparable, of one seed or of two.
    """
    selections = _selections(runs, methods, subjects)
    first = selections[0]
    check_comparable([each for of in selections for group in of.groups for each in group.ok])
    columns = tuple(column for metric in GEOMETRY_METRICS for column in _columns(metric))
    rows = tuple(
        _row([group for each in selections for group in each.groups if group.method == base.method],
             len(first.subjects))
        for base in first.groups
    )  # fmt: skip
    table = Table(
        name="seeds",
        title="Mesh geometry over seeds",
        dataset=first.dataset,
        recipe=first.recipe,
        protocol=first.protocol,
        columns=(*columns, _SEEDS),
        rows=rows,
        remarks=(
            *first.remarks,
            "SD seeds: standard deviation of the mean from seed to seed; SD subjects: of the "
            "subjects' values, each averaged over its seeds",
        ),
    )
    return with_common_means(table)


def _selections(
    runs: Sequence[Sequence[Record]],
    methods: Sequence[str] | None,
    subjects: Sequence[str] | None,
) -> list[Selection]:
    """What is wanted of each run; later ones have the methods that a seed changes alone."""
    first = select(runs[0], methods, subjects)
    kept = [first]
    for run in runs[1:]:
        present = {record.method_name for record in run}
        wanted = [group.method for group in first.groups if group.method in present]
        if wanted:
            kept.append(select(run, wanted, first.subjects))
    return kept


def _columns(metric: str) -> tuple[Column, ...]:
    column = metric_column(metric)
    title, latex = METRICS[metric].title, METRICS[metric].latex_title
    return (
        column,
        *(
            replace(
                column,
                id=f"{metric}_sd_{over}",
                title=f"{title} SD {over}",
                latex_title=f"{latex} SD {over}",
                digits=column.digits + (over == "seeds"),
                ranked=False,
            )
            for over in ("seeds", "subjects")
        ),
    )


def _row(groups: Sequence[Group], of: int) -> Row:
    """One method; subjects without numbers under some seed do not count."""
    check_one_method([record for group in groups for record in group.ok])
    by_seed = [{record.subject: record for record in group.ok} for group in groups]
    common = [subject for subject in by_seed[0] if all(subject in each for each in by_seed)]
    cells: dict[str, Cell] = {"seeds": Cell(len(groups))}
    for metric in GEOMETRY_METRICS if common else ():
        cells |= _Values(
            tuple(
                {subject: found[subject].metrics[metric].value for subject in common}
                for found in by_seed
            )
        ).cells(metric)
    kept = replace(groups[0], ok=tuple(by_seed[0][subject] for subject in common))
    return kept.row(of, cells)
