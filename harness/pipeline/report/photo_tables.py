"""``harness report --table photos``: the figures without a scan, made where they are not there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from harness.core.records import Record
from harness.data.manifest import Manifest
from harness.pipeline.inputs.sealed import Look, admit
from harness.pipeline.inputs.workspace import Workspace
from harness.pipeline.progress import Progress
from harness.pipeline.report.photo_files import PhotoFiles
from harness.pipeline.report.tables import (
    PHOTO_ERRORS_TABLE,
    PHOTOS_TABLE,
    ReportRequest,
    in_order,
    writer_of,
    written,
)
from harness.pipeline.run.store import RunStore
from reports.statistics import bootstrap_ends
from reports.tables.photo_errors import photo_errors_table
from reports.tables.photos import photos_table

#: Tables of figures that are not in the records, by name.
PHOTO_TABLES = {PHOTOS_TABLE: photos_table, PHOTO_ERRORS_TABLE: photo_errors_table}


@dataclass(frozen=True, slots=True)
class PhotoReport:
    """A table of figures without a scan.

    Attributes:
        request: Its table is one of ``PHOTO_TABLES``.
        store: The run.
        manifest: Says which datasets are sealed.
        workspace: Where the photos lie.
        reason: Why sealed subjects are looked at; needed for these only.
    """

    request: ReportRequest
    store: RunStore
    manifest: Manifest
    workspace: Workspace
    reason: str = ""


def build_photo_table(report: PhotoReport, progress: Progress) -> str:
    """The table as text; figures that are not there are made first, and kept.

    Raises:
        HarnessError: nothing to report, or sealed subjects without a reason.
    """
    request = report.request
    # Before anything that takes long.
    write = writer_of(request.format)
    records = [
        record
        for record in in_order(report.store.records(), request.methods or ())
        if request.subjects is None or record.subject in request.subjects
    ]
    files = PhotoFiles(report.store, report.workspace)
    _admit(report, files.waiting(records), progress)
    figures = files.figures(records, progress)
    table = PHOTO_TABLES[request.table](
        records,
        figures.scores,
        figures.absent,
        methods=tuple(dict.fromkeys(record.method_name for record in records)),
        interval=bootstrap_ends if request.interval else None,
    )
    return written(table, write)


def _admit(report: PhotoReport, waiting: Sequence[Record], progress: Progress) -> None:
    """A look at sealed subjects' photos is logged before."""
    for dataset in dict.fromkeys(record.dataset for record in waiting):
        if dataset not in report.manifest.datasets:
            continue
        mine = [record for record in waiting if record.dataset == dataset]
        subjects = tuple(dict.fromkeys(record.subject for record in mine))
        methods = tuple(dict.fromkeys(record.method_name for record in mine))
        what = f"table {report.request.table}"
        look = Look(what, dataset, subjects, report.reason, methods, mine[0].recipe)
        admit(report.manifest, report.workspace, look, progress)
