"""One scored cell of the run matrix (method x subject), and its form on disk."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal, get_args

from harness.core.artifacts import StageCost
from harness.core.errors import DataError
from harness.core.files.atomic import read_json, write_json
from harness.core.privileges import Privilege
from harness.core.units import UNITS_RULE

__all__ = ["RECORD_SCHEMA", "MetricValue", "Record", "Status"]

RECORD_SCHEMA = 1

Status = Literal["ok", "failed", "missing"]


@dataclass(frozen=True, slots=True)
class MetricValue:
    """A metric's estimate.

    Attributes:
        value: In ``unit``; lower is better for every metric here.
        unit: ``mm`` or ``deg``.
        n: How many points it is the mean of.
        standard_error: Of the sampling, in ``unit``.
        floor: What the truth itself scores because of the sampling, where that is not 0.
    """

    value: float
    unit: str
    n: int
    standard_error: float
    floor: float = 0.0

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Record:
    """What is known of one method on one subject.

    Attributes:
        key: Content id of ``inputs``; a record with another key is stale. Empty where they could
            not be told, such as for photos that could not be made.
        method: ``MethodInfo.to_dict()``.
        dataset, subject, recipe: What was reconstructed, from which photos.
        protocol: Name, version and hash of the metric protocol.
        capture: Key of the capture and its warnings.
        seed: Root seed of the run.
        status: ``ok``, ``failed`` (it was tried) or ``missing`` (a part is not installed).
        reason: Why not ``ok``.
        metrics: By metric id; empty unless ``ok``.
        stages: Cost by stage.
        details: What the method or the scorer wants a reader to know.
        environment: Host, package versions, commit and dirty flag.
        created_utc: ISO 8601.
        scale_rule: What turned the scan's units into metres; empty in records of earlier versions,
            all of whose rules gave metres.
        inputs: Everything that the numbers depend on, in readable form.
        files: sha256 of the results beside the record, by file name, such as ``mesh.ply``.
    """

    key: str
    method: Mapping[str, object]
    dataset: str
    subject: str
    recipe: str
    protocol: Mapping[str, object]
    capture: Mapping[str, object]
    seed: int
    status: Status
    reason: str = ""
    metrics: Mapping[str, MetricValue] = field(default_factory=dict[str, MetricValue])
    stages: tuple[StageCost, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict[str, object])
    environment: Mapping[str, object] = field(default_factory=dict[str, object])
    created_utc: str = ""
    scale_rule: str = ""
    inputs: Mapping[str, object] = field(default_factory=dict[str, object])
    files: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def length_unit(self) -> str:
        """What counts as 1 m in the record's lengths: ``metre``, or ``scan unit``."""
        return "scan unit" if self.scale_rule == UNITS_RULE else "metre"

    @property
    def privileges(self) -> tuple[Privilege, ...]:
        """What the method was given beyond pixels; what a newer version added is left out."""
        values = self.method["privileges"]
        if not isinstance(values, Container):
            return ()
        return tuple(privilege for privilege in Privilege if privilege in values)

    @property
    def method_name(self) -> str:
        """The method's name on the command line."""
        return str(self.method["name"])

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, with the schema's version first."""
        return {"schema": RECORD_SCHEMA, **asdict(self)}

    def save(self, path: Path) -> None:
        """Write ``record.json`` atomically."""
        write_json(path, self.to_dict())

    @classmethod
    def load(cls, path: Path) -> Record:
        """The record in a file.

        Raises:
            DataError: not a record of this schema.
        """
        document = read_json(path)
        schema = document.pop("schema", None)
        if schema != RECORD_SCHEMA:
            raise DataError(
                f"{path} is not a record of this version",
                expected=f"schema {RECORD_SCHEMA}",
                got=str(schema),
                hint="Run the evaluation again to replace it",
            )
        try:
            document["metrics"] = {
                name: MetricValue(**value) for name, value in document["metrics"].items()
            }
            document["stages"] = tuple(StageCost(**stage) for stage in document["stages"])
            record = cls(**document)
        except (KeyError, TypeError, AttributeError) as error:
            raise DataError(f"{path} is not a record", got=str(error)) from error
        if record.status not in get_args(Status):
            raise DataError(
                f"{path} has an unknown status",
                expected=", ".join(get_args(Status)),
                got=str(record.status),
            )
        return record
