"""A stored set of numbers to compare with: what they were, what made them, how far they may go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from harness.core.errors import DataError, HarnessError
from harness.core.files import read_json, write_json
from harness.core.hashing import content_hash
from harness.core.records import Record
from reports.selection import check_comparable

__all__ = [
    "BASELINE_SCHEMA",
    "Baseline",
    "Entry",
    "Tolerance",
    "Value",
    "common_settings",
    "inputs_of",
    "update",
]

BASELINE_SCHEMA = 1

Cell = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far a number may be from its baseline: ``absolute + relative * |baseline|``.

    Attributes:
        absolute: In ``unit``.
        relative: Share of the baseline's number.
        unit: Unit of ``absolute`` and of the numbers that it is for.
    """

    absolute: float
    relative: float
    unit: str

    def allowed(self, baseline: float) -> float:
        """The largest change, in ``unit``, that is not a move."""
        return self.absolute + self.relative * abs(baseline)


#: Equal inputs give equal numbers on one machine; these leave room for another machine's rounding,
#: which reaches the numbers through the renderer and the contouring.
_DEFAULT_TOLERANCES: Mapping[str, Tolerance] = {
    "mm": Tolerance(absolute=0.05, relative=0.005, unit="mm"),
    "deg": Tolerance(absolute=0.05, relative=0.005, unit="deg"),
    "1": Tolerance(absolute=0.0005, relative=0.01, unit="1"),
    "ratio": Tolerance(absolute=0.002, relative=0.0, unit="ratio"),
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
        key: The record's key.
        status: The record's status; numbers exist only when ``ok``.
        metrics: By metric id.
        inputs: What the key is made of, and the packages that ran, as flat texts.
    """

    key: str
    status: str
    metrics: Mapping[str, Value]
    inputs: Mapping[str, str]

    @classmethod
    def of(cls, record: Record) -> Entry:
        """What a baseline keeps of a record."""
        return cls(
            key=record.key,
            status=record.status,
            metrics={name: Value(m.value, m.unit) for name, m in record.metrics.items()},
            inputs=inputs_of(record),
        )


@dataclass(frozen=True, slots=True)
class Baseline:
    """Numbers of one dataset, recipe and protocol, by method and subject."""

    dataset: str
    recipe: str
    protocol: Mapping[str, object]
    tolerances: Mapping[str, Tolerance]
    entries: Mapping[Cell, Entry] = field(default_factory=dict)

    def save(self, path: Path) -> None:
        """Write the baseline atomically, in an order that makes a readable diff."""
        cells = [
            {"method": method, "subject": subject, **asdict(entry)}
            for (method, subject), entry in sorted(self.entries.items())
        ]
        document = {
            "schema": BASELINE_SCHEMA,
            "dataset": self.dataset,
            "recipe": self.recipe,
            "protocol": dict(self.protocol),
            "tolerances": {name: asdict(value) for name, value in self.tolerances.items()},
            "cells": cells,
        }
        write_json(path, document)

    @classmethod
    def load(cls, path: Path) -> Baseline:
        """The baseline in a file.

        Raises:
            DataError: no such file, or not a baseline of this schema.
        """
        document = read_json(path)
        if document.get("schema") != BASELINE_SCHEMA or "cells" not in document:
            raise DataError(
                f"{path} is not a baseline of this version",
                expected=f"schema {BASELINE_SCHEMA} with 'cells'",
                got=f"schema {document.get('schema')}",
                hint="Write it again with --update",
            )
        try:
            return _parse(document)
        except (KeyError, TypeError, AttributeError) as error:
            raise DataError(f"{path} is not a baseline", got=repr(error)) from error


def _parse(document: Mapping[str, object]) -> Baseline:
    cells: list[dict[str, object]] = document["cells"]  # type: ignore[assignment]
    tolerances: dict[str, dict[str, object]] = document["tolerances"]  # type: ignore[assignment]
    return Baseline(
        dataset=str(document["dataset"]),
        recipe=str(document["recipe"]),
        protocol=dict(document["protocol"]),  # type: ignore[call-overload]
        tolerances={name: Tolerance(**value) for name, value in tolerances.items()},  # type: ignore[arg-type]
        entries={
            (str(cell["method"]), str(cell["subject"])): Entry(
                key=str(cell["key"]),
                status=str(cell["status"]),
                metrics={n: Value(**v) for n, v in cell["metrics"].items()},  # type: ignore[attr-defined]
                inputs=dict(cell["inputs"]),  # type: ignore[call-overload]
            )
            for cell in cells
        },
    )


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
        for name, estimate in record.metrics.items():
            if name not in tolerances:
                tolerances[name] = _default_tolerance(name, estimate.unit)
    return Baseline(
        dataset=dataset,
        recipe=recipe,
        protocol=protocol,
        tolerances=tolerances,
        entries={(record.method_name, record.subject): Entry.of(record) for record in records},
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
    return records[0].dataset, recipe, records[0].protocol


def _default_tolerance(metric: str, unit: str) -> Tolerance:
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
    packages = record.environment.get("packages", {})
    flat: dict[str, str] = {}
    _flatten("method", record.method, flat)
    _flatten("protocol", record.protocol, flat)
    _flatten("packages", packages, flat)
    if "code" in record.inputs:
        # One text for all modules: a baseline is read by people.
        flat["code"] = content_hash({"code": record.inputs["code"]})
    return {**flat, "capture": str(record.capture.get("key", "")), "seed": str(record.seed)}


def _flatten(name: str, value: object, into: dict[str, str]) -> None:
    if isinstance(value, Mapping):
        for key, entry in value.items():
            _flatten(f"{name}.{key}", entry, into)
    elif isinstance(value, list | tuple) and any(isinstance(entry, Mapping) for entry in value):
        for index, entry in enumerate(value):
            _flatten(f"{name}.{index}", entry, into)
    else:
        into[name] = str(value)
