"""``harness results verify``: every mesh is scored again; nothing that a record says is believed.

A board that only collects numbers collects mistakes. Here the mesh is what is handed in; the record
must say what anybody finds who measures that mesh. What no mesh can show is listed as not proven.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta

from harness.board.entries import Entry
from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.files.hashing import file_sha256
from harness.core.records import MetricValue, ProtocolStamp, Record, Scores
from harness.core.typed_json import is_array, is_mapping, to_json
from harness.core.units import UNITS_RULE
from harness.data.manifest import Manifest
from harness.files.mesh_files import load_mesh
from harness.run.mesh_scores import mesh_scores
from harness.run.progress import Progress
from harness.run.publication import MESH_FILE
from harness.run.sealed import Look, admit
from harness.run.sources import ScanSet
from harness.run.workspace import Workspace
from reports.tables.selection import check_comparable, check_one_method

_TASK = "meshes scored again"
#: What is said of a subject that is not there.
NO_RECORD = "no record"
#: The same mesh gives the same numbers; machines differ by their last digits.
_RELATIVE, _ABSOLUTE = 1e-4, 1e-3
#: Numbers besides the means: how many points may fall on the other side of a border, and by how
#: much that changes what is of all points, and of those of one region.
_POINTS, _OF_ALL, _OF_REGION, _MOST_SHOWN = 3, (1e-3, 1e-3), (1e-2, 0.02), 80
#: The one form of times, which come after the first and differ by less between machines' clocks.
_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?[+-]\d\d:\d\d")
_FIRST, _CLOCKS = datetime(2020, 1, 1, tzinfo=UTC), timedelta(days=1)


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is wrong with an entry.

    Attributes:
        subject: Whose result; empty where it is of all.
        what: A sentence without a full stop.
    """

    subject: str
    what: str

    def __str__(self) -> str:
        return f"{self.subject}: {self.what}" if self.subject else self.what


@dataclass(frozen=True, slots=True)
class Verification:
    """What was found in an entry.

    Attributes:
        entry: Method and version.
        scored: Subjects whose mesh was scored again.
        failed: Subjects that the record itself says have no result.
        unproven: What records say that no mesh can prove, such as metrics of fitted bodies.
        findings: What is wrong; empty if nothing is.
    """

    entry: str
    scored: tuple[str, ...]
    failed: tuple[str, ...]
    unproven: tuple[str, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True)
class Truths:
    """What results are measured against.

    Attributes:
        manifest: Where datasets and protocols are described.
        workspace: Where the true surfaces are.
        complete: Dataset or split that must be complete; the records' own dataset if empty.
        reason: Why sealed subjects are looked at; needed for these only.
    """

    manifest: Manifest
    workspace: Workspace
    complete: str = ""
    reason: str = ""

    def scans(self, entry: Entry, dataset: str, progress: Progress) -> ScanSet:
        """The true surfaces for an entry of a dataset; a look at sealed ones is logged before."""
        scans = ScanSet.select(self.manifest, self.workspace, self.complete or dataset, ())
        look = Look("results handed in", scans.name, scans.subjects, self.reason, (entry.method,))
        admit(self.manifest, self.workspace, look, progress)
        return scans


def verify_entry(entry: Entry, truths: Truths, progress: Progress) -> Verification:
    """Score every mesh of an entry again, and compare with what its records say.

    Args:
        entry: What was handed in.
        truths: What it is measured against.
        progress: Hears of every mesh.

    Raises:
        HarnessError: an unknown dataset, or a sealed one without a reason.
        DataError: a true surface is not there.
    """
    results = entry.read()
    findings = [Finding(subject, why) for subject, why in results.left_out.items()]
    records = list(results.records.values())
    scored: list[str] = []
    failed: list[str] = []
    unproven: dict[str, None] = {}
    findings += [
        Finding(record.subject, f"of dataset {record.dataset}, which the manifest does not have")
        for record in records
        if record.dataset not in truths.manifest.datasets
    ]
    datasets = sorted({record.dataset for record in records} & truths.manifest.datasets.keys())
    if len(datasets) > 1:
        findings.append(Finding("", f"records of {' and '.join(datasets)} in one entry"))
    records = [record for record in records if record.dataset in datasets[:1]]
    scans = truths.scans(entry, datasets[0], progress) if records else None
    if scans is not None:
        absent = [subject for subject in scans.subjects if subject not in entry.subjects()]
        findings += [Finding(subject, NO_RECORD) for subject in absent]
        findings += [Finding("", what) for what in _apart(records)]
        progress.expect(_TASK, len(records))
    for record in records:
        assert scans is not None
        if record.subject in scans.subjects:
            try:
                faults = list(_faults(record, entry, scans, truths.manifest, unproven))
            except HarnessError as error:
                faults = [str(error)]
            findings += [Finding(record.subject, what) for what in faults]
            (scored if record.status == "ok" else failed).append(record.subject)
            progress.done(_TASK)
        elif record.subject not in scans.dataset.subjects:
            # Of a split, others of its dataset are left out; a board does not get them.
            findings.append(Finding(record.subject, f"no subject of {scans.name}"))
    return Verification(entry.title, tuple(scored), tuple(failed), tuple(unproven), tuple(findings))


def _apart(records: Sequence[Record]) -> Iterator[str]:
    """Why no table can hold all records, if none can."""
    try:
        check_comparable(records)
        check_one_method([record for record in records if record.status == "ok"])
    except ProtocolMismatch as error:
        yield str(error)


def _faults(
    record: Record, entry: Entry, scans: ScanSet, manifest: Manifest, unproven: dict[str, None]
) -> Iterator[str]:
    """What is wrong with one record; what it says and nothing here shows is added to the last."""
    if record.dataset != scans.name:
        yield f"of dataset {record.dataset}, not {scans.name}"
        return
    protocol = manifest.protocols.get(record.protocol.name)
    if protocol is None or ProtocolStamp.of(protocol) != record.protocol:
        known = f"not {protocol.sha}" if protocol else "which the manifest does not have"
        yield f"measured with protocol {record.protocol.text}, {known}"
        return
    yield from _setting_faults(record, scans, manifest)
    yield from date_faults(record)
    if record.is_edited:
        unproven["a record that was edited"] = None
    path = entry.mesh_path(record.subject)
    if record.status != "ok":
        unproven["reasons of failures"] = None
        if record.metrics or record.regions or record.normal_maps:
            yield f"{record.status}, but with numbers"
        if path.exists():
            yield f"{record.status}, but with a mesh"
        return
    if not path.is_file():
        yield "no mesh beside its record"
        return
    sha256 = file_sha256(path)
    if sha256 != record.files.get(MESH_FILE):
        yield f"the mesh (sha256 {sha256[:12]}…) is not the one that was scored"
    scan, truth = scans.load(record.subject)
    found = mesh_scores(load_mesh(path), scan, truth, protocol, misplaced="tell")
    yield from differences(record, found)
    others = {"normal maps": record.normal_maps, "times and memory": record.stages,
              "views": record.capture.views or record.method.views != ()}  # fmt: skip
    names = (name for name in record.metrics if name not in found.metrics)
    unproven.update(dict.fromkeys([*names, *(name for name, said in others.items() if said)]))


def _setting_faults(record: Record, scans: ScanSet, manifest: Manifest) -> Iterator[str]:
    """What a record says otherwise of its scan and photos than the manifest does."""
    rule, views = scans.dataset.scale, record.capture.views
    if record.scale_rule != rule and (record.scale_rule or rule == UNITS_RULE):
        yield f"of the scale rule '{record.scale_rule}', but the dataset's is '{rule}'"
    recipe = manifest.recipes.get(record.recipe)
    if recipe is not None and views not in (0, recipe.rig.views):
        yield f"of {views} photos, but recipe {record.recipe} has {recipe.rig.views}"
    most = max((record.method.view_count or 0) - 1, *(record.method.views or ()), -1)
    if views and most >= max(views, 8):
        yield f"uses view {most} of {views} photos"


def date_faults(record: Record, now: datetime | None = None) -> Iterator[str]:
    """What is wrong with the time at which a record says that it was made.

    Args:
        record: Its time orders the versions of a method.
        now: The time that it is compared with; by default the clock's.
    """
    text = f"made at {record.created_utc}"
    if not _TIME.fullmatch(record.created_utc) or record.made <= _FIRST:
        yield f"made at '{record.created_utc}', which is no time such as 2026-01-31T12:00:00+00:00"
    elif record.made - (now or datetime.now(UTC)) > _CLOCKS:
        yield f"{text}, which is yet to come"
    elif not record.created_utc.endswith("+00:00"):
        yield f"{text}, which is not in UTC"


def differences(record: Record, found: Scores) -> Iterator[str]:
    """What a record says otherwise than its mesh shows, each as a sentence without a full stop."""
    for name, value in found.metrics.items():
        yield from _of_metric(name, record.metrics.get(name), value)
    for name in {**record.regions, **found.regions}:
        if name not in found.regions:
            yield f"errors of a region '{name}', which the scan does not have"
        elif name not in record.regions:
            yield f"no errors of the region '{name}', which its mesh has"
        else:
            said, shown = asdict(record.regions[name]), asdict(found.regions[name])
            yield from _unlike(said, shown, f"of the region '{name}'", _OF_REGION)
    yield from _unlike(to_json(record.diagnostics), to_json(found.diagnostics), "of diagnostics")


def _of_metric(name: str, claimed: MetricValue | None, value: MetricValue) -> Iterator[str]:
    if claimed is None:
        yield f"no {name}, which its mesh has: {value.value:.4f} {value.unit}"
    elif claimed.unit != value.unit or not _same(claimed.value, value.value):
        said = f"{claimed.value:.4f} {claimed.unit}"
        yield f"{name} is {said} in the record, but {value.value:.4f} {value.unit} of the mesh"
    elif not _same(claimed.floor, value.floor):
        said = f"{claimed.floor:.4f}, but {value.floor:.4f} {value.unit}"
        yield f"the floor of {name} is {said} of the scan"
    else:
        yield from _unlike(asdict(claimed), asdict(value), name)


def _same(claimed: float, found: float) -> bool:
    return math.isclose(claimed, found, rel_tol=_RELATIVE, abs_tol=_ABSOLUTE)


def _unlike(
    said: object, found: object, place: str, near: tuple[float, float] = _OF_ALL
) -> Iterator[str]:
    """Where JSON values differ, numbers by more than points on either side of a border explain."""
    if is_mapping(said) and is_mapping(found):
        for name in {**said, **found}:
            yield from _unlike(said.get(name), found.get(name), f"{name} {place}", near)
    elif is_array(said) and is_array(found) and len(said) == len(found):
        for one, other in zip(said, found, strict=True):
            yield from _unlike(one, other, place, near)
    elif not _alike(said, found, near):
        texts = (str(value)[:_MOST_SHOWN] for value in (said, found))
        yield "{} is {} in the record, but {} of the mesh".format(place, *texts)


def _alike(said: object, found: object, near: tuple[float, float]) -> bool:
    if isinstance(found, bool) or not isinstance(found, int | float):
        return said == found
    if isinstance(said, bool) or not isinstance(said, int | float):
        return False
    relative, absolute = (near[0], _POINTS) if isinstance(found, int) else near
    return math.isclose(said, found, rel_tol=relative, abs_tol=absolute)
