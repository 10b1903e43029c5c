"""``harness report --table photos``: the figures without a scan, made where they are not there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import read_json, write_json
from harness.core.files.hashing import content_hash
from harness.core.photo_scores import PhotoScores
from harness.core.records import Record
from harness.core.typed_json import from_json, to_json
from harness.data.manifest import Manifest
from harness.files.mesh_files import load_mesh
from harness.report.tables import (
    PHOTO_ERRORS_TABLE,
    PHOTOS_TABLE,
    ReportRequest,
    in_order,
    writer_of,
    written,
)
from harness.run.photo_figures import photo_quality, photo_scoring_code
from harness.run.progress import Progress
from harness.run.publication import MESH_FILE, NORMALS_FILE, load_normals
from harness.run.sealed import Look, admit
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from reports.statistics import bootstrap_ends
from reports.tables.photos import photo_errors_table, photos_table

PHOTOS_FILE = "photos.json"
_SCHEMA = 1
_TASK = "compared"


@dataclass(frozen=True, slots=True)
class PhotoFigures:
    """The figures of some records.

    Attributes:
        scores: By method and subject.
        absent: Why a record has none, likewise.
    """

    scores: Mapping[tuple[str, str], PhotoScores]
    absent: Mapping[tuple[str, str], str]


class PhotoFiles:
    """The stored figures of a run, and how they are made.

    Args:
        store: The run.
        workspace: Where its photos lie.
    """

    def __init__(self, store: RunStore, workspace: Workspace) -> None:
        self._store = store
        self._workspace = workspace
        self._code = photo_scoring_code().to_dict()

    def waiting(self, records: Sequence[Record]) -> list[Record]:
        """The records with a result whose figures are not there, or are of something else."""
        return [r for r in records if r.status == "ok" and r.recipe and self._stored(r) is None]

    def figures(self, records: Sequence[Record], progress: Progress) -> PhotoFigures:
        """The figures of all records with a result; what is missing is made and kept.

        Raises:
            DataError: a file of a result is not what its record measured, or nothing can be
                written.
        """
        waiting = self.waiting(records)
        if waiting:
            progress.expect(_TASK, len(waiting))
        scores: dict[tuple[str, str], PhotoScores] = {}
        absent: dict[tuple[str, str], str] = {}
        for record in records:
            cell = (record.method_name, record.subject)
            if record.status != "ok":
                continue
            if not record.recipe:
                absent[cell] = "the mesh was made elsewhere, from photos that are not known"
                continue
            found = self._stored(record)
            if found is None:
                capture = self._capture(record)
                if isinstance(capture, str):
                    absent[cell] = capture
                else:
                    found = self._made(record, capture)
                progress.done(_TASK)
            if found is not None:
                scores[cell] = found
        return PhotoFigures(scores, absent)

    def _path(self, record: Record) -> Path:
        folder = self._store.cell(record.method_name, record.subject)
        return folder.directory / PHOTOS_FILE

    def _key(self, record: Record) -> str:
        return content_hash(
            {
                "mesh": record.files.get(MESH_FILE, ""),
                "normals": record.files.get(NORMALS_FILE, ""),
                "photos": record.capture.key,
                **self._code,
            }
        )

    def _stored(self, record: Record) -> PhotoScores | None:
        path = self._path(record)
        if not path.is_file():
            return None
        document = read_json(path)
        if (document.get("schema"), document.get("key")) != (_SCHEMA, self._key(record)):
            return None
        return from_json(PhotoScores, document.get("scores"), path, "figures of photos")

    def _capture(self, record: Record) -> Capture | str:
        """The photos that a record's method saw, counted from the front; or why they are gone."""
        folder = self._workspace.capture(record.dataset, record.subject, record.recipe)
        try:
            capture = Capture.load(folder)
        except HarnessError:
            return "its photos are not there any more"
        if capture.key != record.capture.key:
            return "its photos were made anew since"
        if damage := capture.damage():
            raise DataError(damage, hint="Delete the folder and render again")
        return capture.from_front()

    def _made(self, record: Record, capture: Capture) -> PhotoScores:
        mesh = load_mesh(self._store.result(record, MESH_FILE))
        maps = ()
        if NORMALS_FILE in record.files:
            maps = load_normals(self._store.result(record, NORMALS_FILE))
        found = photo_quality(mesh, capture, maps)
        document = {"schema": _SCHEMA, "key": self._key(record), "scores": to_json(found)}
        write_json(self._path(record), document)
        return found


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
    return written(request.named(table), write)


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
