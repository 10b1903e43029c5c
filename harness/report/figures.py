"""Figures of a run: loads photos, scans and meshes, measures errors, passes them to the reports."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.core.artifacts import Capture, NormalMaps, Scan
from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.hashing import content_hash
from harness.core.files.names import suffix_of
from harness.core.files.npz import read_required_arrays, write_npz
from harness.core.mesh import Mesh
from harness.core.protocols import Privilege
from harness.core.records import Record
from harness.core.truth import face_regions, true_body
from harness.core.units import UNITS_RULE
from harness.data.manifest import Manifest
from harness.files.mesh_files import load_mesh
from harness.geometry.raycast import Raycaster, Side
from harness.geometry.surface import SurfaceIndex
from harness.report.tables import ReportRequest, in_order, table_of_protocols
from harness.run.normal_scores import true_normals
from harness.run.progress import Progress
from harness.run.publication import BODY_FILE, MESH_FILE, NORMALS_FILE, load_body_mesh, load_normals
from harness.run.record_inputs import require_photos, require_scan
from harness.run.sealed import Look, admit
from harness.run.sources import Source
from harness.run.store import RunStore
from harness.run.uncalibrated import found_and_true
from harness.run.view_choice import views_for
from harness.run.workspace import Workspace
from metrics.body import VertexErrors, vertex_errors
from metrics.normals import angular_error_map
from metrics.regions import FAR_MM
from reports.figures.charts import RigPanel, rank_curves, rig_figure, view_curves
from reports.figures.comparison import (
    MethodMesh,
    NormalPanels,
    NormalRow,
    SubjectPanels,
    body_overlay,
    normal_grid,
    overlay_figure,
    qualitative_grid,
)
from reports.figures.failures import (
    FailedMesh,
    FailurePanel,
    FailureRow,
    failure_grid,
    worst_region,
    worst_subjects,
)
from reports.figures.panels import ErrorScale
from reports.statistics import bootstrap_ends
from reports.tables.normals import headline
from reports.tables.selection import Asked
from reports.tables.views import view_series, views_table

_FOLDER = ".vertex-errors"
#: Grows when ``metrics.body`` measures something else.
_VERSION = 1
_ARRAYS = ("distance_mm", "normal_deg")


class TrueSurface:
    """A subject's true surface, prepared for queries on the first one.

    Attributes:
        scan: Where it came from.
        mesh: World metres.
        identity: Content id of the scan and its rules.
    """

    def __init__(self, scan: Scan, mesh: Mesh) -> None:
        self.scan, self.mesh = scan, mesh
        self.identity = content_hash(scan.identity())
        self._index: SurfaceIndex | None = None

    @property
    def index(self) -> SurfaceIndex:
        """The surface as an index, built once."""
        if self._index is None:
            self._index = SurfaceIndex(self.mesh)
        return self._index


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredMesh:
    """A record's mesh, world metres, with the errors of its vertices."""

    mesh: Mesh
    errors: VertexErrors


def measured_mesh(store: RunStore, record: Record, truth: TrueSurface) -> MeasuredMesh:
    """The mesh of a record with its errors; measured now, unless they were before.

    They are kept in the run's folder, by the digests of both surfaces, in single precision. A run
    in a folder that may not be written is measured each time.

    Raises:
        DataError: mesh or scan is gone or is not the one that was scored, or kept errors are
            damaged.
    """
    require_scan(record, truth.scan)
    mesh = load_mesh(store.result(record, MESH_FILE))
    path = _path(store, record, truth)
    if path.is_file():
        hint = "Delete it: it will be measured again"
        kept = read_required_arrays(path, _ARRAYS, "errors of vertices", hint)
        return MeasuredMesh(mesh, VertexErrors(*(kept[name].astype(float) for name in _ARRAYS)))
    found = vertex_errors(mesh, truth.index)
    arrays = {name: getattr(found, name).astype(np.float32) for name in _ARRAYS}
    if os.access(store.directory, os.W_OK):
        write_npz(path, arrays, compressed=False)
    # What is kept and what is not must be the same numbers.
    return MeasuredMesh(mesh, VertexErrors(*(arrays[name].astype(float) for name in _ARRAYS)))


def _path(store: RunStore, record: Record, truth: TrueSurface) -> Path:
    key = {"mesh": record.files[MESH_FILE], "truth": truth.identity, "version": _VERSION}
    return store.directory / _FOLDER / f"{content_hash(key)}.npz"


def normals(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:
    """Normal maps of the first method that has them for all of the source's subjects.

    A method with maps in several photos shows their near sides; a method with one photo
    both sides.

    Raises:
        HarnessError: no method has maps of all subjects.
    """
    chosen = _first_complete(records, source.subjects)
    normal_grid([_row(store, source, record) for record in chosen], path)
    return path


def _first_complete(records: Sequence[Record], subjects: Sequence[str]) -> list[Record]:
    """The records, by subject, of the first method with normal maps of all of them."""
    by_method: dict[str, dict[str, Record]] = {}
    for record in records:
        if record.status == "ok" and record.normal_maps:
            by_method.setdefault(record.method_name, {})[record.subject] = record
    for found in by_method.values():
        if found.keys() >= set(subjects):
            return [found[subject] for subject in subjects]
    raise HarnessError(
        f"no method has normal maps of all of {', '.join(subjects)}",
        hint="Run 'harness eval --method econ,mexecon8'; records of earlier versions have none",
    )


def _row(store: RunStore, source: Source, record: Record) -> NormalRow:
    views = load_normals(store.result(record, NORMALS_FILE))
    scan, truth = source.load(record.subject)
    capture = replace(source, suffix=suffix_of(record.recipe)).capture(record.subject)
    require_scan(record, scan)
    require_photos(record, capture)
    # Maps count the photos as the method did.
    capture = views_for(record.method, capture).capture
    caster = Raycaster(truth.geometry())
    shown: list[tuple[NormalMaps, Side]] = [(maps, "near") for maps in views]
    if len(views) == 1:
        shown.append((views[0], "far"))
    return NormalRow(
        capture,
        tuple(_panels(record, maps, side, caster) for maps, side in shown),
    )


def _panels(record: Record, maps: NormalMaps, side: Side, scan: Raycaster) -> NormalPanels:
    true = true_normals(scan, maps, side)
    estimate = maps.front if side == "near" else maps.back
    found = headline(record, maps.view, side)
    return NormalPanels(
        title=found.photo.capitalize() if side == "near" else "",
        maps=maps,
        side=side,
        true=true.normals,
        errors_deg=angular_error_map(estimate, true.normals, true.compared),
        body_text=found.body,
        estimate_text=found.estimate,
    )


def views(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:  # noqa: ARG001
    """Error over the number of photos, with 95 % intervals over the source's subjects.

    Raises:
        HarnessError: no method was run with several numbers of views.
        ProtocolMismatch: the records are not comparable.
    """
    table = views_table(records, Asked(subjects=source.subjects, interval=bootstrap_ends))
    count = len(source.subjects)
    caption = f"{table.dataset}, {table.recipe}, {count} subject{'s' * (count != 1)}"
    return view_curves(view_series(table), path, f"{caption}; bands: 95 % of the mean")


def ranks(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:
    """Each method's rank under each protocol, with 95 % intervals over the source's subjects.

    Raises:
        HarnessError: no further protocol was measured in this run.
        ProtocolMismatch: the records are not comparable.
    """
    methods = tuple(dict.fromkeys(record.method_name for record in records))
    table = table_of_protocols(store, ReportRequest(methods=methods, subjects=source.subjects))
    count = len(source.subjects)
    caption = f"{table.dataset}, {count} subject{'s' * (count != 1)}; bars: 95 % of the rank"
    return rank_curves(table, path, caption)


#: Errors beyond this share of all vertices take the last colour.
_SCALE_PERCENTILE = 98.0
_LEAST_SCALE_MM = 1.0
_MOST_FAILURES = 4


def qualitative(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:
    """Photo, every method's mesh, truth and error maps of the source's subjects, as one figure.

    Only methods that succeeded on all of these subjects are shown.

    Raises:
        HarnessError: no method did.
    """
    titles = _complete_methods(records, source.subjects)
    panels: list[SubjectPanels] = []
    largest = _LEAST_SCALE_MM
    for subject in source.subjects:
        truth = TrueSurface(*source.load(subject))
        meshes: list[MethodMesh] = []
        for method, title in titles.items():
            found = measured_mesh(store, _record(records, method, subject), truth)
            errors_mm = found.errors.distance_mm
            largest = max(largest, float(np.percentile(errors_mm, _SCALE_PERCENTILE)))
            meshes.append(MethodMesh(title, found.mesh, errors_mm))
        capture = _photos(source, subject, records, titles)
        panels.append(SubjectPanels(capture, truth.mesh, tuple(meshes)))
    qualitative_grid(panels, path, _scale(source, largest))
    return path


def overlay(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:
    """The mesh of the first method that succeeded, over all photos of the first subject."""
    subject = source.subjects[0]
    method = next(iter(_complete_methods(records, (subject,))))
    mesh = load_mesh(store.result(_record(records, method, subject), MESH_FILE))
    overlay_figure(mesh, _photos(source, subject, records, (method,)), path)
    return path


def bodies(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:
    """The fitted bodies of all methods that have one, over the photos of the first subject.

    Raises:
        HarnessError: no method fitted a body to it.
    """
    subject = source.subjects[0]
    scan, _ = source.load(subject)
    rows: list[MethodMesh] = []
    drawn: list[str] = []
    for method, title in _complete_methods(records, (subject,)).items():
        record = _record(records, method, subject)
        if BODY_FILE in record.files:
            require_scan(record, scan)
            drawn.append(method)
            body = load_body_mesh(store.result(record, BODY_FILE), source=title)
            rows.append(MethodMesh(title, body))
    if not rows:
        raise HarnessError(
            f"no method fitted a body to {subject}", hint="Run 'harness eval --method jmbo8'"
        )
    capture = _photos(source, subject, records, drawn)
    body_overlay(rows, _true_mesh(scan, rows), capture, path)
    return path


def _true_mesh(scan: Scan, rows: Sequence[MethodMesh]) -> Mesh | None:
    """The true body, if one of the fitted ones is of its model and has its faces."""
    true = true_body(scan)
    if true is None:
        return None
    same = (row.mesh for row in rows if len(row.mesh.vertices) == len(true.vertices))
    faces = next((mesh.faces for mesh in same), None)
    return None if faces is None else Mesh(true.vertices, faces, source="true body")


def failures(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:
    """Where each method is worst, on the (at most four) subjects with the worst regions.

    The last colour stands for the distance from which on surface counts as missing or bulging.

    Raises:
        HarnessError: no record of these subjects has errors by region.
        DataError: the labels of a scan are gone since it was scored.
    """
    shown = {
        (record.method_name, record.subject): record
        for record in records
        if record.subject in source.subjects and _is_rival(record) and worst_region(record)
    }
    if not shown:
        raise HarnessError(
            f"no record of {', '.join(source.subjects[:4])} has errors by region",
            hint="Evaluate subjects whose scans have labels; records of earlier versions lack them",
        )
    chosen = worst_subjects(shown.values(), _MOST_FAILURES)
    titles = {record.method_name: record.method.title for record in shown.values()}
    rows = [_failure_row(store, source, subject, titles, shown) for subject in chosen]
    failure_grid(rows, path, _scale(source, FAR_MM))
    return path


def _failure_row(
    store: RunStore,
    source: Source,
    subject: str,
    titles: Mapping[str, str],
    shown: Mapping[tuple[str, str], Record],
) -> FailureRow:
    scan, mesh = source.load(subject)
    truth = TrueSurface(scan, mesh)
    regions = face_regions(scan, mesh)
    if regions is None:
        raise DataError(f"the scan of {subject} has no labels any more")
    panels: list[FailurePanel] = []
    for method, title in titles.items():
        record = shown.get((method, subject))
        failure = worst_region(record) if record else None
        found = None
        if record and failure:
            measured = measured_mesh(store, record, truth)
            found = FailedMesh(measured.mesh, measured.errors.distance_mm, failure)
        panels.append(FailurePanel(title, found))
    capture = _photos(source, subject, list(shown.values()), titles)
    names = np.array(regions.names)[regions.of_face]
    return FailureRow(capture, mesh, names, tuple(panels))


def cameras(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:
    """Estimated and true cameras of each subject, seen from above and from the front.

    Raises:
        HarnessError: no row has estimated cameras.
    """
    del store
    panels: list[RigPanel] = []
    for record in records:
        suffix = suffix_of(record.recipe)
        shown = [panel.title for panel in panels]
        if record.status != "ok" or not suffix or record.subject in shown:
            continue
        capture = Capture.load(replace(source, suffix=suffix).capture_directory(record.subject))
        require_photos(record, capture)
        _, truth = source.load(record.subject)
        points = truth.vertices[:: max(1, len(truth.vertices) // 2000)]
        known = found_and_true(capture)[1]
        panels.append(RigPanel(record.subject, capture.cameras, known, points))
    if not panels:
        raise HarnessError(
            "no row has estimated cameras", hint="Run 'harness eval --cameras estimated'"
        )
    return rig_figure(panels, path)


#: Figures by name.
FIGURES = {
    "qualitative": qualitative,
    "overlay": overlay,
    "bodies": bodies,
    "failures": failures,
    "normals": normals,
    "views": views,
    "ranks": ranks,
    "cameras": cameras,
}


def _photos(
    source: Source, subject: str, records: Sequence[Record], methods: Iterable[str]
) -> Capture:
    """A subject's photos.

    Raises:
        DataError: one of these methods saw others.
    """
    capture, shown = source.capture(subject), set(methods)
    for record in records:
        if record.subject == subject and record.method_name in shown:
            require_photos(record, capture)
    return capture


def _record(records: Sequence[Record], method: str, subject: str) -> Record:
    """The record of a cell that is known to have one."""
    return next(
        record for record in records if (record.method_name, record.subject) == (method, subject)
    )


def _is_rival(record: Record) -> bool:
    """Whether it has a mesh of a method that was not given the truth, which is shown apart."""
    return record.status == "ok" and Privilege.GROUND_TRUTH_MESH not in record.privileges


def _complete_methods(records: Sequence[Record], subjects: Sequence[str]) -> dict[str, str]:
    """Titles by name of the methods with a mesh of their own of every subject."""
    titles: dict[str, str] = {}
    done: dict[str, set[str]] = {}
    for record in records:
        if _is_rival(record):
            titles[record.method_name] = record.method.title
            done.setdefault(record.method_name, set()).add(record.subject)
    complete = {name: title for name, title in titles.items() if done[name] >= set(subjects)}
    if not complete:
        raise HarnessError(
            f"no method reconstructed all of {', '.join(subjects)}",
            hint="Name fewer subjects with --subjects, or see 'harness report' for the reasons",
        )
    return complete


def _scale(source: Source, limit_mm: float) -> ErrorScale:
    """Colours up to a limit; their label says where mm are no real millimetres."""
    if source.scale_rule == UNITS_RULE:
        return ErrorScale(limit_mm, "distance to the true surface (thousandths of a scan unit)")
    return ErrorScale(limit_mm)


@dataclass(frozen=True, slots=True)
class FigureRequest:
    """What ``harness report --figure`` was asked for.

    Attributes:
        name: Name in ``FIGURES``.
        store: The run.
        methods: Methods in this order; all if empty.
        subjects: Subjects in this order; all that have been photographed if empty.
        reason: Why sealed subjects are drawn; needed for these only.
        output: The file to write; by default named after the figure, in the run's folder.
    """

    name: str
    store: RunStore
    methods: tuple[str, ...] = ()
    subjects: tuple[str, ...] = ()
    reason: str = ""
    output: Path | None = None


def draw_figure(
    request: FigureRequest, manifest: Manifest, workspace: Workspace, progress: Progress
) -> Path:
    """The file of a figure that is drawn now; a look at sealed subjects is logged before.

    Raises:
        HarnessError: an unknown figure, nothing to draw, or sealed subjects without a reason.
    """
    if request.name not in FIGURES:
        raise HarnessError(
            f"unknown figure '{request.name}'", hint=did_you_mean(request.name, FIGURES)
        )
    records = in_order(request.store.records(), request.methods)
    source = _source(request, records, manifest, workspace)
    methods = tuple(dict.fromkeys(record.method_name for record in records))
    what = f"figure {request.name}"
    look = Look(what, source.name, source.subjects, request.reason, methods, source.recipe_name)
    admit(manifest, workspace, look, progress)
    path = request.output or request.store.directory / f"{request.name}.png"
    return FIGURES[request.name](request.store, source, records, path)


def _source(
    request: FigureRequest, records: Sequence[Record], manifest: Manifest, workspace: Workspace
) -> Source:
    """The photographed subjects of some records, or those asked for."""
    photographed = [record for record in records if record.recipe]
    if not photographed:
        raise HarnessError(
            f"{request.store.directory} has no record of photos", hint="Run 'harness eval'"
        )
    first = photographed[0]
    subjects = request.subjects or tuple(dict.fromkeys(record.subject for record in photographed))
    return Source.select(manifest, workspace, first.dataset, subjects, first.recipe)
