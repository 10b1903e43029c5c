"""The normals table: how far estimated normal maps are from the scan's, and what the body's tell.

One row per method, photo and side. In print the pixels are those of garments and shoes, where an
estimator has something to add to the body; CSV and JSON have the whole subject's as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

from harness.core.errors import DataError
from harness.core.records import Record
from harness.core.units import Unit
from reports.tables.selection import Group, select
from reports.tables.table import Cell, Column, Interval, Row, Table, mean_cell

__all__ = ["Headline", "headline", "normals_of", "normals_table"]

#: One view and side in a record's details.
Entry = Mapping[str, object]
#: A summary's numbers; None where no pixel tells.
Numbers = Mapping[str, float | None]


@dataclass(frozen=True, slots=True, order=True)
class _PhotoSide:
    """Which photo, by its camera's yaw in degrees, and which side of the subject in it."""

    view: int
    yaw_deg: float
    side: str


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
    """A number of a summary: its field, and how a column shows it."""

    field: str
    id: str
    title: str
    latex_title: str
    unit: Unit
    digits: int
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class _Quantity:
    """A column and what it shows: a measure of the ``estimate`` or the ``body``, which pixels'."""

    column: Column
    measure: _Measure
    of: str
    pixels: str


_MEASURES = (
    _Measure("mean_deg", "error", "Error", "Error", Unit.degree, 2),
    _Measure("median_deg", "median", "Median", "Median", Unit.degree, 2),
    *(
        _Measure(f"share_{name}", name, f"< {text}°", rf"$<{text}^\circ$", Unit.percent, 1, 100.0)
        for name, text in (("below_11_25", "11.25"), ("below_22_5", "22.5"), ("below_30", "30"))
    ),
)
#: Their ids say for what and over which pixels; in print they are clear from the caption.
_PREFIXES = {"estimate": "", "body": "body_"}, {"clothed": "", "all": "all_"}
_SHORT_TITLES = {"body_error": "Body", "all_error": "All pixels"}
_REMARKS = (
    "Angle between estimated and true normals on the pixels of garments and shoes: mean, median, "
    "and how many are less off than so many degrees; each the mean over subjects",
    "Body: the mean of the fitted body's own normals on the same pixels; ratio: of the two means",
    "Near side: what the photo shows; far side: the last surface along the same rays, which it "
    "hides",
    "All pixels: the mean over the whole subject, with skin and hair",
)
_UNLABELLED = "Scans without labels of garments: every column is over all pixels of the subject"


def _quantity(measure: _Measure, of: str, pixels: str) -> _Quantity:
    names, areas = _PREFIXES
    name = f"{areas[pixels]}{names[of]}{measure.id}"
    words = [
        word for word, shown in (("body", of == "body"), ("all pixels", pixels == "all")) if shown
    ]
    about = f" ({', '.join(words)})" if words else ""
    short = _SHORT_TITLES.get(name)
    column = Column(
        id=name,
        title=short or f"{measure.title}{about}",
        latex_title=short or f"{measure.latex_title}{about}",
        unit=measure.unit.value,
        digits=measure.digits,
        ranked=False,
    )
    return _Quantity(column, measure, of, pixels)


_QUANTITIES = {
    quantity.column.id: quantity
    for quantity in (
        *(
            _quantity(m, of, pixels)
            for pixels in _PREFIXES[1]
            for of in _PREFIXES[0]
            for m in _MEASURES
        ),
        _quantity(_Measure("n", "pixels", "Pixels", "Pixels", Unit.none, 0), "estimate", "clothed"),
    )
}
_RATIO = Column("ratio", "Ratio", "Ratio", Unit.none.value, 2, ranked=False)
_PRINTED = ("median", "below_11_25", "below_22_5", "below_30", "all_error")


def normals_table(
    records: Sequence[Record],
    *,
    methods: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
    interval: Interval | None = None,
    published: bool = False,
) -> Table:
    """The errors of some records' normal maps: a pure function of them.

    Methods with a record that tells nothing of normal maps are named in a remark; without any other
    method there are no rows. Arguments and errors are those of ``geometry_table``.
    """
    selection = select(records, methods, subjects)
    told = [group for group in selection.groups if group.ok and all(map(normals_of, group.ok))]
    untold = [group for group in selection.groups if group not in told]
    columns = {name: quantity.column for name, quantity in _QUANTITIES.items()}
    printed = (columns["body_error"], columns["error"], _RATIO, *(columns[n] for n in _PRINTED))
    rows = [
        _row(group, key, len(selection.subjects), interval)
        for group in told
        for key in _keys(group)
    ]
    return Table(
        name="normals",
        title="Normal maps",
        dataset=selection.dataset,
        recipe=selection.recipe,
        protocol=selection.protocol,
        columns=printed,
        more=tuple(column for column in columns.values() if column not in printed),
        rows=tuple(rows),
        remarks=(
            *_REMARKS,
            *_estimator_remarks(told),
            *selection.remarks,
            *_absence_remarks(untold),
            *(["The paper prints no errors of normal maps"] if published else []),
        ),
    )


def normals_of(record: Record) -> Sequence[Entry]:
    """The errors of a record's normal maps by view and side; empty for a method without maps."""
    return cast("Sequence[Entry]", record.details.get("normal_maps", ()))


def headline(record: Record, view: int, side: str) -> Headline:
    """The mean errors of one map, over garments and shoes; over all pixels where these have none.

    Raises:
        DataError: the record tells nothing of this view and side.
    """
    for entry in normals_of(record):
        if (entry["view"], entry["side"]) == (view, side):
            title = _photo_title(_key(entry).yaw_deg)
            means = _means_deg(entry, "clothed") or _means_deg(entry, "all")
            texts = [f"{mean:.1f}° off" for mean in means] if means else ["not compared"] * 2
            return Headline(title, *texts)
    raise DataError(
        f"the record of {record.method_name}/{record.subject} does not tell how good the normals "
        f"of view {view}, {side} side, are",
        hint="Evaluate it again",
    )


def _means_deg(entry: Entry, pixels: str) -> tuple[float, float] | None:
    summaries = cast("Mapping[str, Numbers] | None", entry[pixels])
    if summaries is None:
        return None
    estimate, body = (summaries[of]["mean_deg"] for of in ("estimate", "body"))
    return None if estimate is None or body is None else (estimate, body)


def _photo_title(yaw_deg: float) -> str:
    """Which photo it is, for people, by its camera's yaw."""
    return {0.0: "front photo", 180.0: "back photo"}.get(yaw_deg, f"photo at {yaw_deg:.0f}°")


def _keys(group: Group) -> list[_PhotoSide]:
    """The photos and sides of a method's records, near sides first."""
    keys = {_key(entry) for record in group.ok for entry in normals_of(record)}
    return sorted(keys, key=lambda key: (key.side != "near", key))


def _key(entry: Entry) -> _PhotoSide:
    view, yaw_deg, side = entry["view"], entry["yaw_deg"], entry["side"]
    return _PhotoSide(cast(int, view), cast(float, yaw_deg), cast(str, side))


def _row(group: Group, key: _PhotoSide, of: int, interval: Interval | None) -> Row:
    entries = [entry for record in group.ok for entry in normals_of(record) if _key(entry) == key]
    labelled = all(map(_labelled, entries))
    cells: dict[str, Cell] = {}
    for name, quantity in _QUANTITIES.items():
        pixels = quantity.pixels if labelled else "all"
        found = [_number(entry, quantity, pixels) for entry in entries]
        values = [value for value in found if value is not None]
        if values:
            cells[name] = mean_cell(values, interval)
    if "error" in cells and cells["body_error"].value > 0:
        cells["ratio"] = Cell(cells["error"].value / cells["body_error"].value)
    row = group.row(of, cells)
    return replace(
        row,
        title=f"{row.title}: {_photo_title(key.yaw_deg)}, {key.side} side",
        n=len(entries),
        notes=(*row.notes, *([] if labelled else [_UNLABELLED])),
    )


def _labelled(entry: Entry) -> bool:
    return entry.get("clothed") is not None


def _number(entry: Entry, quantity: _Quantity, pixels: str) -> float | None:
    """In the column's unit; None where no pixel tells."""
    measure = quantity.measure
    summaries = cast("Mapping[str, Numbers]", entry[pixels])
    value = summaries[quantity.of][measure.field]
    return None if value is None else measure.factor * value


def _estimator_remarks(told: Sequence[Group]) -> list[str]:
    """Which estimator made whose maps."""
    made: dict[str, list[str]] = {}
    for group in told:
        parts = cast("Sequence[Mapping[str, str]]", group.ok[0].method.get("parts", ()))
        for part in parts:
            if part["role"] == "normal estimator":
                made.setdefault(part["name"], []).append(group.title)
    texts = [f"{name} ({'; '.join(titles)})" for name, titles in made.items()]
    return [f"Estimators: {', '.join(texts)}"] if texts else []


def _absence_remarks(untold: Sequence[Group]) -> list[str]:
    """Methods with a record without normal maps, and how many."""
    names = [
        f"{group.title} ({sum(not normals_of(record) for record in group.ok)} of {len(group.ok)} "
        "records)"
        for group in untold
    ]
    why = "the method makes none, or the record is older than they"
    return [f"Without normal maps, because {why}: {'; '.join(names)}"] if names else []
