"""The region table: where on the body each method's surface is wrong, mean over subjects.

The columns in print are completeness alone, which missing limbs raise and nothing can hide from;
accuracy, normals, and the shares of missing and bulging surface go to CSV and JSON.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from harness.core.errors import DataError
from harness.core.records import Record, RegionErrors
from harness.core.units import Unit
from reports.tables.selection import EVERYTHING, Asked, Group, select
from reports.tables.table import Column, Table, cells_of, with_common_means


@dataclass(frozen=True, slots=True)
class RegionGroup:
    """One column: the regions of the labels that it puts together."""

    id: str
    title: str
    regions: frozenset[str]


REGION_GROUPS = (
    RegionGroup("head", "Head", frozenset({"head", "eyes"})),
    RegionGroup("hair", "Hair", frozenset({"hair"})),
    RegionGroup("torso", "Torso", frozenset({"torso", "t-shirt", "shirt", "long-sleeved shirt"})),
    RegionGroup("arms", "Arms", frozenset({"arms"})),
    RegionGroup("hands", "Hands", frozenset({"hands"})),
    RegionGroup("legs", "Legs", frozenset({"legs", "straight trousers", "shorts"})),
    RegionGroup("feet", "Feet", frozenset({"feet", "shoes"})),
    RegionGroup(
        "loose",
        "Loose clothes",
        frozenset(
            {
                *("loose shirt", "hooded sweater", "jacket", "coat", "dress"),
                *("wide trousers", "skirt"),
            }
        ),
    ),
)
#: A region counts on subjects where it is at least this share of the surface: a few points at the
#: edge of a collar tell nothing, and would weigh as much as another subject's whole back.
LEAST_SHARE = 0.005
_REMARKS = (
    "Mean distance of each region's true surface to the prediction, over the subjects where it is "
    f"at least {100 * LEAST_SHARE:g} % of the surface",
    "Torso: with close-fitting tops and their sleeves; arms: bare; legs: with close-fitting "
    "trousers; feet: with shoes",
)
_ABSENT = "errors by region, because the scan has no labels, or the record is older than they"


@dataclass(frozen=True, slots=True)
class _Measure:
    """A quantity of a region.

    Attributes:
        id: In column ids.
        title: After the region's.
        unit: Unit of the numbers.
        digits: Decimals.
        read: The number of one region.
        points: How many points it is a mean of; None if regions add up.
    """

    id: str
    title: str
    unit: Unit
    digits: int
    read: Callable[[RegionErrors], float | None]
    points: Callable[[RegionErrors], int] | None


def _on_truth(errors: RegionErrors) -> int:
    return errors.n_truth


def _on_prediction(errors: RegionErrors) -> int:
    return errors.n_predicted


_COMPLETENESS = _Measure(
    "completeness", "completeness", Unit.millimetre, 1, lambda e: e.completeness_mm, _on_truth
)
_MORE = (
    _Measure("accuracy", "accuracy", Unit.millimetre, 1, lambda e: e.accuracy_mm, _on_prediction),
    _Measure(
        "normal_error", "normal error", Unit.degree, 1, lambda e: e.normal_error_deg, _on_prediction
    ),
    _Measure("missing", "missing", Unit.ratio, 3, lambda e: e.missing_share, _on_truth),
    _Measure("bulge", "bulges", Unit.ratio, 3, lambda e: e.bulge_share, _on_prediction),
    _Measure("area", "area", Unit.ratio, 3, lambda e: e.area_share, None),
)


def regions_table(records: Sequence[Record], asked: Asked = EVERYTHING) -> Table:
    """The errors by region of some records: a pure function of them.

    A subject counts in the columns whose regions it has. Methods with a record without errors
    by region are named in a remark; without any other method there are no rows. Arguments and
    errors are those of ``geometry_table``.
    """
    selection = select(records, asked.methods, asked.subjects)
    shown = selection.shown(_regions)
    measured = any(group.ok for group in shown)
    of = len(selection.subjects)
    table = selection.table(
        name="regions",
        title="Completeness by region",
        columns=(_column(_COMPLETENESS, group) for group in REGION_GROUPS),
        more=tuple(_column(measure, group) for measure in _MORE for group in REGION_GROUPS),
        rows=(
            group.row(of, cells_of(_READERS, group.by_subject, asked.interval))
            for group in shown
            if measured
        ),
        remarks=(
            *_REMARKS,
            *_subject_remarks(shown),
            *selection.remarks,
            *filter(None, [selection.absence(shown, _regions, _ABSENT)]),
            *(["The paper prints no errors by region"] if asked.published else []),
        ),
    )
    return with_common_means(table)


def _column(measure: _Measure, group: RegionGroup) -> Column:
    printed = measure is _COMPLETENESS
    title = group.title if printed else f"{group.title}, {measure.title}"
    return Column(
        id=f"{measure.id}_{group.id}",
        title=title,
        latex_title=title,
        unit=measure.unit.value,
        digits=measure.digits,
        ranked=printed,
    )


def _pooled(record: Record, group: RegionGroup, measure: _Measure) -> float | None:
    """One subject's number for a group's regions together, or None where no point tells."""
    parts = _parts(record, group)
    if measure.points is None:
        return sum(_known(measure.read(part)) for part in parts) if parts else None
    counts = [measure.points(part) for part in parts]
    total = sum(
        _known(measure.read(part)) * count
        for part, count in zip(parts, counts, strict=True)
        if count
    )
    return total / sum(counts) if any(counts) else None


def _parts(record: Record, group: RegionGroup) -> list[RegionErrors]:
    """The regions of a group that a subject has; none if all of them together are too small."""
    parts = [part for name, part in record.regions.items() if name in group.regions]
    large = sum(part.area_share for part in parts) >= LEAST_SHARE
    return parts if large else []


def _known(value: float | None) -> float:
    """A number that is None only where there are no points, which the caller has checked."""
    if value is None:
        raise DataError("a record's region has points but no error", hint="Evaluate it again")
    return value


def _subject_remarks(shown: Sequence[Group]) -> list[str]:
    """How many subjects count in a column, where that is not all; and labels of no column."""
    records = {record.subject: record for group in shown for record in group.ok}
    counts = {
        group.title: sum(bool(_parts(record, group)) for record in records.values())
        for group in REGION_GROUPS
    }
    some = [f"{title} {count}" for title, count in counts.items() if count < len(records)]
    known = frozenset().union(*(group.regions for group in REGION_GROUPS))
    labels = {name for record in records.values() for name in record.regions}
    return [
        *([f"Not on all of {len(records)} subjects: {', '.join(some)}"] if some else []),
        *([f"In no column: {', '.join(sorted(labels - known))}"] if labels - known else []),
    ]


def _regions(record: Record) -> object:
    return record.regions


_READERS = {
    f"{measure.id}_{group.id}": partial(_pooled, group=group, measure=measure)
    for measure in (_COMPLETENESS, *_MORE)
    for group in REGION_GROUPS
}
