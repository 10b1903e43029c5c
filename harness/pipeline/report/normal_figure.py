"""The normals figure of a run: loads maps and scans, compares them, passes them to the reports."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from harness.core.artifacts import NormalMaps
from harness.core.errors import HarnessError
from harness.core.records import Record
from harness.geometry.raycast import Raycaster, Side
from harness.pipeline.inputs.sources import Source
from harness.pipeline.inputs.view_choice import views_for
from harness.pipeline.run.record_inputs import require_photos, require_scan
from harness.pipeline.run.result_files import NORMALS_FILE, load_normals
from harness.pipeline.run.store import RunStore
from harness.pipeline.scoring.normals import true_normals
from metrics.normal_maps import angular_error_map
from reports.figures.normal_grid import NormalPanels, NormalRow, normal_grid
from reports.tables.normals import headline


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
    capture = source.capture(record.subject)
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
