"""The normals table: how far estimated normal maps are from the scan's, and what the body's tell.

One row per method, photo and side. In print the pixels are those of garments and shoes, where an
estimator has something to add to the body; CSV and JSON have the whole subject's as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from harness.core.errors import DataError
from harness.core.records import AngularErrors, AngularPair, FoldErrors, NormalMapErrors, Record
from harness.core.units import Unit
from reports.tables.selection import EVERYTHING, Asked, Group, select
from reports.tables.table import Cell, Column, Interval, Row, Table, mean_cell


@dataclass(frozen=True, slots=True, order=True)
class _PhotoSide:
    """Which photo, by its camera's yaw in degrees, and which side of the subject in it."""

    view: int
    yaw_deg: float
    side: str

    @classmethod
    def of(cls, errors: NormalMapErrors) -> _PhotoSide:
        return cls(errors.view, errors.yaw_deg, errors.side)


@dataclass(frozen=True, slots=True)
class Headline:
    """What a figure says of one map.

    Attributes:
        photo: Which photo it is of, for people.
        estimate, body: Their mean errors, as text.
    """

    photo: str
    estimate: str
    body: str


@dataclass(frozen=True, slots=True)
class _Measure:
    """A number of a summary, and how a column shows it."""

    id: str
    title: str
    latex_title: str
    unit: Unit
    digits: int
    read: Callable[[AngularErrors], float | None]
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class _Quantity:
    """What a column shows: a measure of the estimate or of the body, on which pixels."""

    measure: _Measure
    of_body: bool = False
    of_whole_subject: bool = False

    @property
    def column(self) -> Column:
        """Its id says what it is of; in print the caption does."""
        measure = self.measure
        prefix = f"{'all_' if self.of_whole_subject else ''}{'body_' if self.of_body else ''}"
        name = f"{prefix}{measure.id}"
        shown = {"body": self.of_body, "all pixels": self.of_whole_subject}
        words = [word for word, is_shown in shown.items() if is_shown]
        about = f" ({', '.join(words)})" if words else ""
        short = _SHORT_TITLES.get(name)
        return Column(
            id=name,
            title=short or f"{measure.title}{about}",
            latex_title=short or f"{measure.latex_title}{about}",
            unit=measure.unit.value,
            digits=measure.digits,
            ranked=False,
        )

    def value(self, errors: NormalMapErrors, *, labelled: bool) -> float | None:
        """In the column's unit, over all pixels where nothing is labelled; None without pixels."""
        clothed = labelled and not self.of_whole_subject
        pair = errors.clothed if clothed and errors.clothed else errors.whole
        found = self.measure.read(pair.body if self.of_body else pair.estimate)
        return None if found is None else self.measure.factor * found


_DEG, _PERCENT = Unit.degree, Unit.percent
_MEASURES = (
    _Measure("error", "Error", "Error", _DEG, 2, lambda errors: errors.mean_deg),
    _Measure("median", "Median", "Median", _DEG, 2, lambda errors: errors.median_deg),
    _Measure(
        "below_11_25", "< 11.25°", r"$<11.25^\circ$", _PERCENT, 1,
        lambda errors: errors.share_below_11_25, 100.0,
    ),
    _Measure(
        "below_22_5", "< 22.5°", r"$<22.5^\circ$", _PERCENT, 1,
        lambda errors: errors.share_below_22_5, 100.0,
    ),
    _Measure(
        "below_30", "< 30°", r"$<30^\circ$", _PERCENT, 1,
        lambda errors: errors.share_below_30, 100.0,
    ),
)  # fmt: skip
_PIXELS = _Measure("pixels", "Pixels", "Pixels", Unit.none, 0, lambda errors: errors.n)
_FOLDS = {
    "folds": Column("folds", "Folds (estimate)", "Folds (estimate)", _DEG.value, 2, ranked=False),
    "true_folds": Column("true_folds", "Folds (scan)", "Folds (scan)", _DEG.value, 2, ranked=False),
    "folds_share": Column("folds_share", "Folds", "Folds", _PERCENT.value, 0, ranked=False),
    "fold_correlation": Column(
        "fold_correlation", "Correlation", "Correlation", Unit.none.value, 2, ranked=False
    ),
}
_SHORT_TITLES = {"body_error": "Body", "all_error": "All pixels"}
_REMARKS = (
    "Angle between estimated and true normals on the pixels of garments and shoes: mean, median, "
    "and how many are less off than so many degrees; each the mean over subjects",
    "Body: the mean of the fitted body's own normals on the same pixels; ratio: of the two means",
    "Near side: what the photo shows; far side: the last surface along the same rays, which it "
    "hides",
    "All pixels: the mean over the whole subject, with skin and hair",
)
_FOLD_REMARK = (
    "Folds: strength of the estimate's folds, the mean angle between normals and the same blurred "
    "by 15 mm, as a share of the scan's; correlation: of what that blur takes away; both over the "
    "whole subject"
)
_ABSENT = "normal maps, because the method makes none, or the record is older than they"
_UNLABELLED = "Scans without labels of garments: every column is over all pixels of the subject"

_QUANTITIES = {
    quantity.column.id: quantity
    for quantity in (
        *(
            _Quantity(measure, of_body, of_whole_subject)
            for of_whole_subject in (False, True)
            for of_body in (False, True)
            for measure in _MEASURES
        ),
        _Quantity(_PIXELS),
    )
}
_RATIO = Column("ratio", "Ratio", "Ratio", Unit.none.value, 2, ranked=False)
_PRINTED = ("median", "below_11_25", "below_22_5", "below_30", "all_error")
_PRINTED_FOLDS = ("folds_share", "fold_correlation")


def normals_table(records: Sequence[Record], asked: Asked = EVERYTHING) -> Table:
    """The errors of some records' normal maps: a pure function of them.

    Methods with a record without normal maps are named in a remark; without any other
    method there are no rows. Arguments and errors are those of ``geometry_table``.
    """
    selection = select(records, asked.methods, asked.subjects)
    shown = [group for group in selection.shown(_maps) if group.ok]
    rows = [
        _row(group, key, len(selection.subjects), asked.interval)
        for group in shown
        for key in _keys(group)
    ]
    has_folds = any("folds" in row.cells for row in rows)
    columns = {name: quantity.column for name, quantity in _QUANTITIES.items()} | _FOLDS
    names = (*_PRINTED, *(_PRINTED_FOLDS if has_folds else ()))
    printed = (columns["body_error"], columns["error"], _RATIO, *(columns[n] for n in names))
    return selection.table(
        name="normals",
        title="Normal maps",
        columns=printed,
        more=tuple(column for column in columns.values() if column not in printed),
        rows=rows,
        remarks=(
            *_REMARKS,
            *([_FOLD_REMARK] if has_folds else []),
            *_estimator_remarks(shown),
            *selection.remarks,
            *filter(None, [selection.absence(shown, _maps, _ABSENT)]),
            *(["The paper prints no errors of normal maps"] if asked.published else []),
        ),
    )


def headline(record: Record, view: int, side: str) -> Headline:
    """The mean errors of one map, over garments and shoes; over all pixels where these have none.

    Raises:
        DataError: the record has nothing of this view and side.
    """
    for errors in record.normal_maps:
        if (errors.view, errors.side) == (view, side):
            pair = errors.clothed if errors.clothed and _is_known(errors.clothed) else errors.whole
            known = _is_known(pair)
            return Headline(
                photo=_photo_title(errors.yaw_deg),
                estimate=_mean_text(pair.estimate, known=known),
                body=_mean_text(pair.body, known=known),
            )
    raise DataError(
        f"the record of {record.method_name}/{record.subject} does not tell how good the normals "
        f"of view {view}, {side} side, are",
        hint="Evaluate it again",
    )


def _is_known(pair: AngularPair) -> bool:
    """Whether there are pixels."""
    return pair.estimate.mean_deg is not None and pair.body.mean_deg is not None


def _mean_text(errors: AngularErrors, *, known: bool) -> str:
    return f"{errors.mean_deg:.1f}° off" if known else "not compared"


def _photo_title(yaw_deg: float) -> str:
    """Which photo it is, for people, by its camera's yaw."""
    return {0.0: "front photo", 180.0: "back photo"}.get(yaw_deg, f"photo at {yaw_deg:.0f}°")


def _maps(record: Record) -> object:
    return record.normal_maps


def _keys(group: Group) -> list[_PhotoSide]:
    """The photos and sides of a method's records, near sides first."""
    keys = {_PhotoSide.of(errors) for record in group.ok for errors in record.normal_maps}
    return sorted(keys, key=lambda key: (key.side != "near", key))


def _row(group: Group, key: _PhotoSide, of: int, interval: Interval | None) -> Row:
    entries = [
        errors
        for record in group.ok
        for errors in record.normal_maps
        if _PhotoSide.of(errors) == key
    ]
    labelled = all(errors.clothed is not None for errors in entries)
    cells: dict[str, Cell] = {}
    for name, quantity in _QUANTITIES.items():
        found = [quantity.value(errors, labelled=labelled) for errors in entries]
        values = [value for value in found if value is not None]
        if values:
            cells[name] = mean_cell(values, interval)
    if "error" in cells and cells["body_error"].value > 0:
        cells["ratio"] = Cell(cells["error"].value / cells["body_error"].value)
    cells |= _fold_cells([each.folds for each in entries if each.folds], interval)
    row = group.row(of, cells)
    return replace(
        row,
        title=f"{row.title}: {_photo_title(key.yaw_deg)}, {key.side} side",
        n=len(entries),
        notes=(*row.notes, *([] if labelled else [_UNLABELLED])),
    )


def _fold_cells(folds: Sequence[FoldErrors], interval: Interval | None) -> dict[str, Cell]:
    """The cells of ``_FOLDS`` that some records' folds fill."""
    if not folds:
        return {}
    cells = {
        "folds": mean_cell([each.estimate_deg for each in folds], interval),
        "true_folds": mean_cell([each.truth_deg for each in folds], interval),
        "fold_correlation": mean_cell([each.correlation for each in folds], interval),
    }
    if cells["true_folds"].value > 0:
        share = cells["folds"].value / cells["true_folds"].value
        cells["folds_share"] = Cell(100.0 * share)
    return cells


def _estimator_remarks(shown: Sequence[Group]) -> list[str]:
    """Which estimator made whose maps."""
    made: dict[str, list[str]] = {}
    for group in shown:
        for part in group.ok[0].method.parts:
            if part.role == "normal estimator":
                made.setdefault(part.name, []).append(group.title)
    texts = [f"{name} ({'; '.join(titles)})" for name, titles in made.items()]
    return [f"Estimators: {', '.join(texts)}"] if texts else []
