"""A stored set of numbers to compare with: what they were, what made them, how far they may go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import read_json, write_json
from harness.core.files.hashing import content_hash
from harness.core.records import Record
from harness.core.typed_json import from_json, to_json
from harness.core.units import Unit
from reports.tables.selection import check_comparable

BASELINE_SCHEMA = 1

Cell = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far a number may be from its baseline: ``absolute + relative * |baseline|``.

    Attributes:
        absolute: In ``unit``.
        relative: Share of the baseline's number.
        unit: Unit of ``absolute`` and of the numbers that it is for.
        source: Where it comes from.
    """

    absolute: float
    relative: float
    unit: str
    source: str = ""

    def allowed(self, baseline: float) -> float:
        """The largest change, in ``unit``, that is not a move."""
        return self.absolute + self.relative * abs(baseline)


_ROUNDING = "room for another machine's rounding in the renderer and the contouring"
#: Equal inputs give equal numbers on one machine.
_DEFAULT_TOLERANCES: Mapping[str, Tolerance] = {
    "mm": Tolerance(absolute=0.05, relative=0.005, unit="mm", source=_ROUNDING),
    "deg": Tolerance(absolute=0.05, relative=0.005, unit="deg", source=_ROUNDING),
    "1": Tolerance(absolute=0.0005, relative=0.01, unit="1", source=_ROUNDING),
    "ratio": Tolerance(absolute=0.002, relative=0.0, unit="ratio", source=_ROUNDING),
}


@dataclass(frozen=True, slots=True)
class Value:
    """A number with its unit."""

    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class Entry:
    """One cell of the baseline.

    Attributes:
        method, subject: Which cell.
        key: The record's key.
        status: The record's status; numbers exist only when ``ok``.
        metrics: By metric id.
        inputs: What the key is made of, and the packages that ran, as flat texts.
    """

    method: str
    subject: str
    key: str
    status: str
    metrics: Mapping[str, Value]
    inputs: Mapping[str, str]

    @classmethod
    def of(cls, record: Record) -> Entry:
        """What a baseline keeps of a record."""
        return cls(
            record.method_name,
            record.subject,
            key=record.key,
            status=record.status,
            metrics=numbers_of(record),
            inputs=inputs_of(record),
        )


@dataclass(frozen=True, slots=True)
class Baseline:
    """Numbers of one dataset, recipe and protocol, by method and subject.

    Attributes:
        dataset, recipe: What the numbers were made of.
        protocol: All settings of the metric protocol and their sha.
        tolerances: By metric, or by ``method/metric`` where a method has its own.
        new_methods: Methods that have no numbers here on purpose, with the reason.
        cells: By method and subject.
    """

    dataset: str
    recipe: str
    protocol: Mapping[str, object]
    tolerances: Mapping[str, Tolerance]
    new_methods: Mapping[str, str] = field(default_factory=dict[str, str])
    cells: tuple[Entry, ...] = ()

    @property
    def entries(self) -> dict[Cell, Entry]:
        """The cells by method and subject."""
        return {(each.method, each.subject): each for each in self.cells}

    def tolerance(self, method: str, metric: str) -> Tolerance:
        """How far a method's number may be from its baseline.

        Raises:
            DataError: the baseline has none for it.
        """
        for name in (f"{method}/{metric}", metric):
            if name in self.tolerances:
                return self.tolerances[name]
        raise DataError(f"the baseline has no tolerance for {metric}", hint="Add it, or --update")

    def save(self, path: Path) -> None:
        """Write the baseline atomically, in an order that makes a readable diff."""
        ordered = replace(
            self,
            tolerances=dict(sorted(self.tolerances.items())),
            cells=tuple(entry for _, entry in sorted(self.entries.items())),
        )
        write_json(path, {"schema": BASELINE_SCHEMA, **to_json(ordered)})

    @classmethod
    def load(cls, path: Path) -> Baseline:
        """The baseline in a file.

        Raises:
            DataError: no such file, or not a baseline of this schema.
        """
        if not path.is_file():
            raise DataError(f"no file at {path}", hint="Write a run's numbers there with --update")
        document = read_json(path)
        if document.get("schema") != BASELINE_SCHEMA or "cells" not in document:
            raise DataError(
                f"{path} is not a baseline of this version",
                expected=f"schema {BASELINE_SCHEMA} with 'cells'",
                got=f"schema {document.get('schema')}",
                hint="Write it again with --update",
            )
        del document["schema"]
        # A baseline that lists no new methods need not say so.
        return from_json(cls, {"new_methods": {}, **document}, path, "a baseline")


def numbers_of(record: Record) -> dict[str, Value]:
    """The numbers of a record that a baseline guards.

    Its metrics, and the mean error in degrees of each normal map that the method made, on all
    pixels of the subject: ``normal_map_0_near`` is the near side of view 0. Its fold strength is
    ``normal_folds_0_near``.
    """
    numbers = {name: Value(m.value, m.unit) for name, m in record.metrics.items()}
    for errors in record.normal_maps:
        mean_deg = errors.whole.estimate.mean_deg
        if mean_deg is not None:
            name = f"normal_map_{errors.view}_{errors.side}"
            numbers[name] = Value(mean_deg, Unit.degree.value)
        if errors.folds is not None:
            name = f"normal_folds_{errors.view}_{errors.side}"
            numbers[name] = Value(errors.folds.estimate_deg, Unit.degree.value)
    return numbers


def update(records: Sequence[Record], previous: Baseline | None = None) -> Baseline:
    """The baseline that some records make, with the tolerances of the one that it replaces.

    Raises:
        HarnessError: no records.
        ProtocolMismatch: records of more than one dataset, recipe or protocol.
        DataError: a metric in a unit that has no default tolerance.
    """
    dataset, recipe, protocol = common_settings(records)
    tolerances = dict(previous.tolerances) if previous else {}
    for record in records:
        for name, number in numbers_of(record).items():
            if name not in tolerances:
                tolerances[name] = default_tolerance(name, number.unit)
    return Baseline(
        dataset=dataset,
        recipe=recipe,
        protocol=protocol,
        tolerances=tolerances,
        new_methods=dict(previous.new_methods) if previous else {},
        cells=tuple(map(Entry.of, records)),
    )


def common_settings(records: Sequence[Record]) -> tuple[str, str, Mapping[str, object]]:
    """Dataset, recipe and protocol that all records share.

    Raises:
        HarnessError: no records.
        ProtocolMismatch: they do not share them.
    """
    if not records:
        raise HarnessError("there are no records to compare", hint="Run 'harness eval' first")
    check_comparable(records)
    recipe = next((record.recipe for record in records if record.recipe), "")
    return records[0].dataset, recipe, records[0].protocol.to_flat()


def default_tolerance(metric: str, unit: str) -> Tolerance:
    """What a metric in this unit has as long as none was measured for it.

    Raises:
        DataError: a unit that has no default.
    """
    if unit not in _DEFAULT_TOLERANCES:
        raise DataError(
            f"no default tolerance for {metric}",
            expected=" or ".join(_DEFAULT_TOLERANCES),
            got=unit,
            hint="Write one under 'tolerances' in the baseline file",
        )
    return _DEFAULT_TOLERANCES[unit]


def inputs_of(record: Record) -> dict[str, str]:
    """What a record's key is made of, and the packages that ran, as flat texts by dotted name."""
    packages = record.environment.packages if record.environment else {}
    flat: dict[str, str] = {}
    _flatten("method", record.method.to_dict(), flat)
    _flatten("protocol", record.protocol.to_flat(), flat)
    _flatten("packages", packages, flat)
    if "code" in record.inputs:
        # One text for all modules: a baseline is read by people.
        flat["code"] = content_hash({"code": record.inputs["code"]})
    return {**flat, "capture": record.capture.key, "seed": str(record.seed)}


def _flatten(name: str, value: object, into: dict[str, str]) -> None:
    if isinstance(value, Mapping):
        for key, entry in value.items():
            _flatten(f"{name}.{key}", entry, into)
    elif isinstance(value, list | tuple) and any(isinstance(entry, Mapping) for entry in value):
        for index, entry in enumerate(value):
            _flatten(f"{name}.{index}", entry, into)
    else:
        into[name] = str(value)
