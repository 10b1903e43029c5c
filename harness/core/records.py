"""The record of one cell of the run matrix (method x subject): its schema, and its form on disk.

Every key of ``record.json`` is a field of a dataclass, here or in ``harness.core.results``,
``artifacts`` (stages) and ``protocols`` (the method), with its explanation below it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from harness.core.artifacts import StageCost
from harness.core.errors import DataError
from harness.core.files.atomic import read_json, write_json
from harness.core.formats.typed_json import from_json, to_json
from harness.core.privileges import Privilege
from harness.core.protocols import RING, MethodInfo
from harness.core.results import Diagnostics, MetricValue, NormalMapErrors, RegionErrors
from harness.core.settings import MetricProtocol
from harness.core.units import UNITS_RULE

RECORD_SCHEMA = 4
_EARLIER_SCHEMAS = (2, 3)

Status = Literal["ok", "failed", "missing"]


@dataclass(frozen=True, slots=True)
class ProtocolStamp:
    """Which metric protocol made the numbers."""

    name: str
    """As on the command line."""
    version: int | None
    """The protocol's digest; None where others measured and gave none."""
    sha: str
    """Content id of all settings; empty likewise."""
    settings: MetricProtocol | None = None
    """All settings; None likewise."""

    @classmethod
    def of(cls, protocol: MetricProtocol) -> ProtocolStamp:
        """The stamp of numbers that are measured here."""
        return cls(protocol.name, protocol.version, protocol.sha, protocol)

    @property
    def text(self) -> str:
        """Name, version and sha in words."""
        version = "" if self.version is None else f" version {self.version} (sha {self.sha})"
        return f"{self.name}{version}"

    def to_flat(self) -> dict[str, object]:
        """All settings and the sha in one object, as tables for programs show them."""
        if self.settings is None:
            return {"name": self.name, "version": self.version, "sha": self.sha}
        return {**asdict(self.settings), "sha": self.sha}


@dataclass(frozen=True, slots=True)
class CaptureStamp:
    """Which photos the method saw."""

    key: str = ""
    """Content id of everything that made the photos; empty where there were none."""
    views: int = 0
    """How many photos there were; 0 where that is not known."""
    warnings: tuple[str, ...] = ()
    """What is wrong with the photos, such as a view in which the frame cuts the subject."""


@dataclass(frozen=True, slots=True)
class Environment:
    """Where and with what a record was made."""

    harness: str = ""
    """Version of this package."""
    python: str = ""
    """Version of the interpreter."""
    system: str = ""
    """Operating system with its version."""
    machine: str = ""
    """Processor architecture."""
    cpus: int | None = None
    """Number of logical processors."""
    packages: Mapping[str, str | None] = field(default_factory=dict[str, str | None])
    """Version by name of each package that numbers may depend on; None where not installed."""
    commit: str | None = None
    """The checkout's commit; None where the package was installed."""
    dirty: bool | None = None
    """Whether the checkout had changes that are in no commit; None likewise."""


@dataclass(frozen=True, slots=True)
class Record:
    """What is known of one method on one subject."""

    key: str
    """Content id of ``inputs``; a record with another key is stale. Empty where the inputs are not
    known, such as for photos that could not be made."""
    method: MethodInfo
    """What the method says of itself, with the settings that it ran with."""
    dataset: str
    """Name of the dataset in the manifest."""
    subject: str
    """Id within the dataset."""
    recipe: str
    """Name of the render recipe of the photos; empty for a mesh made elsewhere."""
    protocol: ProtocolStamp
    """How the mesh became numbers."""
    capture: CaptureStamp
    """The photos."""
    seed: int
    """Root seed of the run."""
    status: Status
    """``ok``, ``failed`` (it was tried) or ``missing`` (a part is not installed)."""
    reason: str = ""
    """Why not ``ok``; empty if it is."""
    metrics: Mapping[str, MetricValue] = field(default_factory=dict[str, MetricValue])
    """Estimates by metric id; empty unless ``ok``."""
    regions: Mapping[str, RegionErrors] = field(default_factory=dict[str, RegionErrors])
    """Errors by region of the true surface; empty where the scan has no labels."""
    normal_maps: tuple[NormalMapErrors, ...] = ()
    """Errors of the method's normal maps by view and side; empty for a method without maps."""
    warnings: tuple[str, ...] = ()
    """Doubts about the numbers: another unit, place or frame, or faces wound inside out."""
    diagnostics: Diagnostics | None = None
    """What stands behind the means; None unless ``ok``."""
    stages: tuple[StageCost, ...] = ()
    """Time and memory by stage of the method, in order."""
    shared_work: tuple[str, ...] = ()
    """What was taken over from another method that had made the same, such as ``body fit``. Its
    stages have the cost that was measured when it was made; memory that it would have left behind
    is not in the peaks of later stages."""
    details: Mapping[str, object] = field(default_factory=dict[str, object])
    """What the method wants a reader to know, as JSON values. Nothing here reads it back."""
    environment: Environment | None = None
    """Where and with what the record was made; None where that is not known."""
    created_utc: str = ""
    """When, ISO 8601."""
    scale_rule: str = ""
    """What turned the scan's units into metres; empty where that is not known."""
    inputs: Mapping[str, object] = field(default_factory=dict[str, object])
    """Everything that the numbers depend on, in readable form: settings, code, photos, truth."""
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    """sha256 of the results beside the record, by file name, such as ``mesh.ply``."""

    @property
    def length_unit(self) -> str:
        """What counts as 1 m in the record's lengths: ``metre``, or ``scan unit``."""
        return "scan unit" if self.scale_rule == UNITS_RULE else "metre"

    @property
    def privileges(self) -> tuple[Privilege, ...]:
        """What the method was given beyond pixels."""
        return self.method.privileges

    @property
    def views_used(self) -> int | None:
        """How many photos the method used; None where that is not known."""
        if self.method.view_count is not None:
            return self.method.view_count
        if self.method.views is None:
            return self.capture.views or None
        views, there = self.method.views, self.capture.views
        if not there or max(views, default=0) < RING:
            # Places of a ring of eight: each has a photo while there are any.
            return min(len(views), there or len(views))
        return len([view for view in views if view < there])

    @property
    def reason_line(self) -> str:
        """The first line of the reason, or that there is none."""
        return next(iter(self.reason.splitlines()), "no reason given")

    @property
    def method_name(self) -> str:
        """The method's name on the command line."""
        return self.method.name

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, with the schema's version first."""
        return {"schema": RECORD_SCHEMA, **to_json(self)}

    def save(self, path: Path) -> None:
        """Write ``record.json`` atomically."""
        write_json(path, self.to_dict())

    @classmethod
    def load(cls, path: Path) -> Record:
        """The record in a file.

        Raises:
            DataError: not a record of this schema.
        """
        return cls.from_document(read_json(path), path)

    @classmethod
    def from_document(cls, document: Mapping[str, Any], source: str | Path) -> Record:
        """The record in plain JSON values, as ``to_dict`` gives them.

        Args:
            document: The values.
            source: Where they come from, for messages.

        Raises:
            DataError: not a record of this schema.
        """
        fields = dict(document)
        schema = fields.pop("schema", None)
        if schema in _EARLIER_SCHEMAS:
            fields, schema = _upgraded(fields), RECORD_SCHEMA
        if schema != RECORD_SCHEMA:
            raise DataError(
                f"{source} is not a record of this version",
                expected=f"schema {RECORD_SCHEMA}",
                got=str(schema),
                hint="Run the evaluation again to replace it",
            )
        return from_json(cls, fields, source, "a record")


def _upgraded(document: dict[str, Any]) -> dict[str, Any]:
    """A document of an earlier schema with the fields that it lacks at their defaults."""
    try:
        return {
            "shared_work": [],
            **document,
            "normal_maps": [{"folds": None, **errors} for errors in document["normal_maps"]],
            "method": {"view_count": None, **document["method"]},
            "capture": {"views": 0, **document["capture"]},
        }
    except (KeyError, TypeError):
        # Not a record; reading says where.
        return document
