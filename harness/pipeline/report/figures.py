"""Figures of a run: loads photos, scans and meshes, measures errors, passes them to the reports."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from harness.core.artifacts import Capture, Scan
from harness.core.errors import DataError, HarnessError
from harness.core.formats.mesh_files import load_mesh
from harness.core.mesh import Mesh
from harness.core.privileges import Privilege
from harness.core.records import Record
from harness.core.truth import face_regions, true_body
from harness.core.units import UNITS_RULE
from harness.pipeline.inputs.sources import Source
from harness.pipeline.report.error_cache import TrueSurface, measured_mesh
from harness.pipeline.report.normal_figure import normals
from harness.pipeline.report.views_figure import ranks, views
from harness.pipeline.run.record_inputs import require_photos, require_scan
from harness.pipeline.run.result_files import BODY_FILE, MESH_FILE, load_body_mesh
from harness.pipeline.run.store import RunStore
from metrics.regions import FAR_MM
from reports.figures.body_overlay import body_overlay
from reports.figures.comparison import (
    MethodMesh,
    SubjectPanels,
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
from reports.figures.shading import ErrorScale

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


#: Figures by name.
FIGURES = {
    "qualitative": qualitative,
    "overlay": overlay,
    "bodies": bodies,
    "failures": failures,
    "normals": normals,
    "views": views,
    "ranks": ranks,
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
