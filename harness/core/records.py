"""A record: one method on one subject, its numbers and everything that they depend on."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from harness.core.artifacts import StageCost
from harness.core.errors import DataError, is_plain, plain_text
from harness.core.field_protocols import FIELD_PROTOCOLS
from harness.core.files.atomic import read_json, write_json
from harness.core.files.hashing import content_hash
from harness.core.files.names import NAME_RULE, is_name
from harness.core.metric_catalog import METRICS
from harness.core.protocols import RING, MethodInfo, Privilege
from harness.core.settings import MetricProtocol
from harness.core.typed_json import from_json, is_array, is_mapping, to_json
from harness.core.units import UNITS_RULE


@dataclass(frozen=True, slots=True)
class MetricValue:
    """The estimate of one metric; lower is better, except for an intersection over union."""

    value: float
    """In ``unit``."""
    unit: str
    """Symbol, such as ``mm`` or ``deg``."""
    n: int
    """How many points or views it is the mean of."""
    standard_error: float
    """What the sampling of points leaves uncertain, in ``unit``."""
    floor: float = 0.0
    """What the truth itself scores because of the sampling, where that is not 0."""


@dataclass(frozen=True, slots=True)
class RegionErrors:
    """The errors of one labelled region of the true surface; None where it has no points."""

    area_share: float
    """The region's share of the true surface, 0 to 1."""
    accuracy_mm: float | None
    """Mean distance to the true surface of the predicted points nearest to the region."""
    completeness_mm: float | None
    """Mean distance of the region's true points to the predicted surface."""
    normal_error_deg: float | None
    """Mean angle between the normals of the predicted points nearest to the region and there."""
    missing_share: float | None
    """Share of the region's true points that are far from the prediction: a missing limb."""
    bulge_share: float | None
    """Share of the predicted points nearest to the region that are far from the truth."""
    n_predicted: int
    """Predicted points nearest to the region."""
    n_truth: int
    """True points on the region."""


@dataclass(frozen=True, slots=True)
class AngularErrors:
    """The angles between two normal maps over some pixels; None where there are no pixels."""

    mean_deg: float | None
    median_deg: float | None
    share_below_11_25: float | None
    """Share of the pixels, 0 to 1, with an error below 11.25 degrees."""
    share_below_22_5: float | None
    """The same for 22.5 degrees."""
    share_below_30: float | None
    """The same for 30 degrees."""
    n: int
    """Pixels."""


@dataclass(frozen=True, slots=True)
class AngularPair:
    """The errors of an estimate, and of the fitted body's own normals on the same pixels."""

    estimate: AngularErrors
    body: AngularErrors


@dataclass(frozen=True, slots=True)
class FoldErrors:
    """The folds of an estimated normal map and the scan's on the same pixels (`metrics.folds`)."""

    estimate_deg: float
    """Fold strength of the estimate: mean angle between normals and their blur, degrees."""
    truth_deg: float
    """The same of the scan."""
    correlation: float
    """How well both agree in what the blur takes away: 1 alike, 0 unrelated."""


@dataclass(frozen=True, slots=True)
class NormalMapErrors:
    """The errors of a method's normal maps in one view, on one side of the subject."""

    view: int
    """Index of the photo, counted from the front."""
    yaw_deg: float
    """Its camera's yaw from the subject's front towards its left, whole degrees, 0 to 359."""
    side: Literal["near", "far"]
    """The surface that the photo shows, or the last one along the same rays."""
    clothed: AngularPair | None
    """Over the pixels of garments and shoes; None where the scan has no labels."""
    whole: AngularPair
    """Over all pixels of the subject."""
    folds: FoldErrors | None
    """Over the same pixels; None where the map is too coarse, or the subject too small in it."""


@dataclass(frozen=True, slots=True)
class BodyErrors:
    """The errors of a fitted body; None where the body or the dataset does not allow a metric.

    Fields are named by metric id, in the order in which records list them.
    """

    silhouette_loss: MetricValue | None = None
    normal_loss: MetricValue | None = None
    landmark_loss: MetricValue | None = None
    silhouette_iou: MetricValue | None = None
    total_loss: MetricValue | None = None
    off_model: MetricValue | None = None
    joint_error: MetricValue | None = None
    vertex_error: MetricValue | None = None

    def by_id(self) -> dict[str, MetricValue]:
        """The metrics that there are, by metric id."""
        found: dict[str, MetricValue | None] = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in found.items() if value is not None}


@dataclass(frozen=True, slots=True)
class DistanceSummary:
    """Percentiles of the sampled distances in one direction."""

    p50_mm: float
    p90_mm: float
    p95_mm: float
    p99_mm: float
    max_sampled_mm: float
    """The largest of them: a lower bound of the Hausdorff distance, which grows with the number of
    points."""


@dataclass(frozen=True, slots=True)
class FScore:
    """Shares of the points, 0 to 1, that are closer to the other surface than a threshold."""

    precision: float
    """Share of the predicted points."""
    recall: float
    """Share of the true points."""
    f: float
    """Harmonic mean of both; 0 where both are 0."""


@dataclass(frozen=True, slots=True)
class NormalSummary:
    """What tells wrong orientation from wrong shape."""

    median_deg: float
    share_over_90: float
    """Share of the predicted normals that point away from the true ones."""
    unoriented_mean_deg: float
    """The mean when a normal and its opposite count as the same, as in some evaluations."""
    truth_to_predicted_mean_deg: float | None
    """The mean over the points of the truth; None where no point has two normals to compare."""


@dataclass(frozen=True, slots=True)
class MeshFacts:
    """Size and health of a mesh."""

    vertices: int
    faces: int
    faces_without_area: int
    extent_m: tuple[float, float, float]
    """Sides of the bounding box along x, y and z."""
    area_m2: float
    signed_volume_m3: float | None
    """None for an open surface, whose volume has no meaning."""
    inverted: bool | None
    """Whether the faces of a (nearly) closed surface are wound inside out; None for an open one."""


@dataclass(frozen=True, slots=True)
class Diagnostics:
    """What stands behind the means of a score."""

    alignment: str
    """``none``, or ``sim3-cameras``: by the cameras, where these were estimated."""
    predicted_to_truth: DistanceSummary
    truth_to_predicted: DistanceSummary
    f_score: Mapping[str, FScore]
    """By threshold, such as ``5_mm``."""
    normals: NormalSummary
    meshes: Mapping[str, MeshFacts]
    """Facts about the ``predicted`` mesh and about the ``truth``."""


@dataclass(frozen=True, slots=True)
class Scores:
    """Every number of one result, and what a reader of them should know."""

    metrics: Mapping[str, MetricValue] = field(default_factory=dict[str, MetricValue])
    """By metric id."""
    regions: Mapping[str, RegionErrors] = field(default_factory=dict[str, RegionErrors])
    """By region's name; empty where the scan has no labels."""
    normal_maps: tuple[NormalMapErrors, ...] = ()
    """One entry for each view and side; empty for a method without normal maps."""
    warnings: tuple[str, ...] = ()
    """Doubts about units, frame or winding of the meshes."""
    diagnostics: Diagnostics | None = None
    """What stands behind the means; None where nothing was measured."""


RECORD_SCHEMA = 5
_EARLIER_SCHEMAS = (2, 3, 4)
#: What warns of a record whose numbers are not those that were written with their digest.
EDITED = "edited: its numbers are not those that were written"
#: The fields with numbers, of which the digest is.
_NUMBERS = ("metrics", "regions", "normal_maps", "diagnostics", "stages")
#: What a record's file may hold, whoever wrote it. Tables sum and square its numbers.
_MOST_DEPTH, _MOST_SHOWN = 32, 60
_Leaves = list[tuple[str, Any]]
_GREATEST_NUMBER, _GREATEST_COUNT, _MOST_VIEWS = 1e15, 2**63, 10_000
#: Of the fields with numbers, those that may be below 0, and those that are at most 1.
_SIGNED, _SHARE = ("signed_volume_m3", "correlation"), re.compile(r"share_.*|.*_share|precision|f")
_SHA256 = re.compile("[0-9a-f]{64}")

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
    settings: Mapping[str, object] | None = None
    """All settings, as the protocol gives them; None likewise."""

    @classmethod
    def of(cls, protocol: MetricProtocol) -> ProtocolStamp:
        """The stamp of numbers that are measured here."""
        return cls(protocol.name, protocol.version, protocol.sha, protocol.to_dict())

    @property
    def text(self) -> str:
        """Name, version and sha in words."""
        version = "" if self.version is None else f" version {self.version} (sha {self.sha})"
        return f"{self.name}{version}"

    def to_flat(self) -> dict[str, object]:
        """All settings and the sha in one object, as tables for programs show them."""
        if self.settings is None:
            return {"name": self.name, "version": self.version, "sha": self.sha}
        # In the protocol's order, whatever that of the file that they were read from.
        named = [f.name for f in fields(MetricProtocol) if f.name in self.settings]
        ordered = dict.fromkeys([*named, *self.settings])
        return {**{name: self.settings[name] for name in ordered}, "sha": self.sha}


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
    identity: str = ""
    """Which person the subject is, where the dataset says so."""
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

    @property
    def is_edited(self) -> bool:
        """Whether numbers were changed after they were written."""
        return EDITED in self.warnings

    @property
    def made(self) -> datetime:
        """``created_utc`` as a time that can be compared; the first of all where it is none."""
        try:
            found = datetime.fromisoformat(self.created_utc)
            return found.replace(tzinfo=found.tzinfo or UTC).astimezone(UTC)
        except (OverflowError, ValueError):
            return datetime.min.replace(tzinfo=UTC)

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, with the schema's version and the digest of the numbers first."""
        document = _shown(to_json(self))
        # Said by few datasets and methods; records without them stay as they were.
        for place, name in ((document, "identity"), (document["method"], "trained_on")):
            if not place[name]:
                del place[name]
        return {"schema": RECORD_SCHEMA, "digest": _digest(document), **document}

    def save(self, path: Path) -> None:
        """Write ``record.json`` atomically."""
        write_json(path, self.to_dict())

    @classmethod
    def load(cls, path: Path, method: str, subject: str, whole: Collection[str] = ()) -> Record:
        """The record in a file.

        Args:
            path: The file.
            method: Whose it must be by its place, which decides where results are looked for.
            subject: Likewise.
            whole: As ``from_document`` has it.

        Raises:
            DataError: not a record of this schema, or one of another method or subject.
        """
        record = cls.from_document(read_json(path), path, whole)
        if (record.method_name, record.subject) != (method, subject):
            raise DataError(
                f"{path} is in the place of another record",
                expected=f"{method} on {subject}",
                got=f"{record.method_name} on {record.subject}",
            )
        return record

    @classmethod
    def from_document(
        cls, document: dict[str, Any], source: str | Path, whole: Collection[str] = ()
    ) -> Record:
        """The record in JSON values, which are used up: the only reader, which trusts nobody.

        Args:
            document: The values, whoever wrote them.
            source: Where they come from, for messages.
            whole: Methods whose records are read and checked whole, which takes milliseconds; all
                if empty. Others' have no numbers, only whose they are.

        Raises:
            DataError: not a record of this schema: another structure, a name that could lead to
                another file, a number that is none or out of range, or a text that cannot be shown.
        """
        if whole and (unread := _unread(document, whole)):
            return unread
        schema = document.pop("schema", None)
        for fault in _faults(document, is_strict=schema == RECORD_SCHEMA):
            raise DataError(f"{source} is not a record", got=fault)
        digest = document.pop("digest", "none") if schema == RECORD_SCHEMA else None
        if schema in _EARLIER_SCHEMAS:
            document, schema = _shown(_upgraded(document)), RECORD_SCHEMA
        if schema != RECORD_SCHEMA:
            raise DataError(
                f"{source} is not a record of this version",
                expected=f"schema {RECORD_SCHEMA}",
                got=str(schema)[:_MOST_SHOWN],
                hint="Run the evaluation again to replace it",
            )
        if isinstance(method := document.get("method"), dict):
            later: dict[str, object] = {"trained_on": [], "needs_perspective": ""}
            document = {"identity": "", **document, "method": {**later, **method}}
        record = from_json(cls, document, source, "a record")
        for fault in _out_of_range(record, document):
            raise DataError(f"{source} is not a record", got=fault)
        if digest not in (None, _digest(document)) and not record.is_edited:
            return replace(record, warnings=(*record.warnings, EDITED))
        return record


def _unread(document: Mapping[str, Any], whole: Collection[str]) -> Record | None:
    """Whose record it is, unless that cannot be told or it is of one of some methods."""
    match document:
        case {
            "method": {"name": str(method)},
            "dataset": str(dataset),
            "subject": str(subject),
        } if method not in whole and all(map(is_name, (method, dataset, subject))):
            rest = "", ProtocolStamp("", None, ""), CaptureStamp(), 0, "missing", "not read"
            return Record("", MethodInfo(method, method), dataset, subject, *rest)
        case _:
            return None


def _digest(document: Mapping[str, Any]) -> str:
    return content_hash({name: document[name] for name in _NUMBERS})


def _shown(value: Any) -> Any:
    """JSON values whose texts can all be shown."""
    if isinstance(value, str):
        return plain_text(value)
    if is_mapping(value):
        return {plain_text(name): _shown(entry) for name, entry in value.items()}
    return [_shown(entry) for entry in value] if is_array(value) else value


def _leaves(value: Any, place: str = "", depth: int = 0, found: _Leaves | None = None) -> _Leaves:
    """Every value that holds no other, and every key, with the names of the fields above it.

    Raises:
        ValueError: more levels than a record has.
    """
    found = [] if found is None else found
    if depth > _MOST_DEPTH:
        raise ValueError(f"more than {_MOST_DEPTH} levels")
    if is_array(value):
        for entry in value:
            _leaves(entry, place, depth + 1, found)
    elif isinstance(value, str | float | int | None) or not is_mapping(value):
        found.append((place, value))
    else:
        for name, entry in value.items():
            found.append((place, name))
            _leaves(entry, f"{place}.{name}"[-_MOST_SHOWN:].lstrip("."), depth + 1, found)
    return found


def _faults(document: Mapping[str, Any], *, is_strict: bool) -> Iterator[str]:
    """What no record has, whatever its fields: depth, endless numbers, signs that hide others."""
    try:
        for place, value in _leaves(document):
            if isinstance(value, str) and is_strict and not is_plain(value):
                yield f"signs at '{plain_text(place)}' that cannot be shown"
            elif isinstance(value, float) and not abs(value) <= _GREATEST_NUMBER:
                yield f"{value} at '{plain_text(place)}'"
            elif isinstance(value, int) and not abs(value) < _GREATEST_COUNT:
                yield f"a number of {value.bit_length()} bits at '{plain_text(place)}'"
    except ValueError as error:
        yield str(error)


def _units(protocol: str) -> dict[str, str]:
    """The unit of each metric; under a publication's protocol the one that it prints."""
    units = {name: metric.unit for name, metric in METRICS.items()}
    printed = FIELD_PROTOCOLS.get(protocol)
    return units | ({column.key: column.unit for column in printed.summary} if printed else {})


def _out_of_range(record: Record, document: Mapping[str, Any]) -> Iterator[str]:
    """What is of the right type and cannot be."""
    for kind, name in (
        ("method", record.method_name),
        ("dataset", record.dataset),
        ("subject", record.subject),
        ("recipe", record.recipe or "none"),
        *(("file", name) for name in record.files),
    ):
        if not is_name(name):
            yield f"{name[:_MOST_SHOWN]!r}, which cannot be the name of a {kind}: {NAME_RULE}"
    for name, sha256 in record.files.items():
        if not _SHA256.fullmatch(sha256):
            yield f"a file {name} without its sha256"
    units = _units(record.protocol.name)
    for name, metric in record.metrics.items():
        if metric.unit != units.get(name, metric.unit):
            yield f"{name} in {metric.unit[:_MOST_SHOWN]!r} instead of {units[name]!r}"
    method, counts = record.method, [record.capture.views]
    counts += [0 if method.view_count is None else method.view_count - 1, *(method.views or ())]
    distinct = len(set(method.views or ())) == len(method.views or ())
    if not (distinct and min(counts) >= 0 and max(counts) <= _MOST_VIEWS):
        yield f"views that are not distinct and from 0 to {_MOST_VIEWS}"
    for place, value in _leaves({name: document[name] for name in _NUMBERS}):
        name = place.rpartition(".")[2]
        most = 1.0 + 1e-9 if _SHARE.fullmatch(name) else _GREATEST_NUMBER
        if isinstance(value, int | float) and name not in _SIGNED and not 0.0 <= value <= most:
            yield f"{value} as its {name}"


def _upgraded(document: dict[str, Any]) -> dict[str, Any]:
    """A document of an earlier schema with the fields that it lacks at their defaults."""
    try:
        return {
            "shared_work": [],
            **document,
            "normal_maps": [{"folds": None, **errors} for errors in document["normal_maps"]],
            "method": {"view_count": None, "needs_perspective": "", **document["method"]},
            "capture": {"views": 0, **document["capture"]},
        }
    except (KeyError, TypeError):
        # Not a record; reading says where.
        return document
