"""``harness report``: records, or figures without a scan, become a table in a format."""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.atomic import read_json, write_json, write_text
from harness.core.files.hashing import content_hash
from harness.core.photo_scores import PhotoScores
from harness.core.protocol_scores import ProtocolScores, RunScores
from harness.core.records import Record
from harness.core.settings import MetricProtocol
from harness.core.typed_json import from_json, to_json
from harness.data.manifest import Manifest
from harness.files.mesh_files import load_mesh
from harness.run.photo_figures import photo_quality, photo_scoring_code
from harness.run.progress import Progress
from harness.run.publication import MESH_FILE, NORMALS_FILE, load_normals
from harness.run.sealed import Look, admit
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from methods.catalog import METHODS
from reports.formats import programs
from reports.formats.latex import to_latex, to_markdown
from reports.published.field import published_under
from reports.published.table import published_differences, published_means
from reports.statistics import bootstrap_ends
from reports.tables.cost import cost_table
from reports.tables.geometry import cameras_table, geometry_table
from reports.tables.jmbo import jmbo_table
from reports.tables.normals import normals_table
from reports.tables.paired import change_table, paired_table
from reports.tables.photos import photo_errors_table, photos_table
from reports.tables.protocols import protocols_table
from reports.tables.regions import regions_table
from reports.tables.selection import Asked
from reports.tables.table import Table
from reports.tables.views import views_table

T = TypeVar("T")
_LEAST_FOR_INTERVALS = 4

#: The table of the authors' own results, which needs no run.
PUBLISHED_TABLE = "published"
#: Tables of figures that need no scan and are not in the records: these, and how they go with the
#: errors that the scan gives.
PHOTOS_TABLE, PHOTO_ERRORS_TABLE = "photos", "photo-errors"
#: The table of several seeds' runs.
SEEDS_TABLE = "seeds"
#: The table of further protocols, which lie beside the records.
PROTOCOLS_TABLE = "protocols"
#: The table of differences, subject by subject.
PAIRED_TABLE = "paired"
#: Tables of a run by name.
TABLES: Mapping[str, Callable[..., Table]] = {
    "geometry": geometry_table,
    PAIRED_TABLE: paired_table,
    "cost": cost_table,
    "jmbo": jmbo_table,
    "regions": regions_table,
    "normals": normals_table,
    "views": views_table,
    "cameras": cameras_table,
}
#: Writer and file name extension by format.
FORMATS: Mapping[str, tuple[Callable[[Table], str], str]] = {
    "latex": (to_latex, "tex"),
    "markdown": (to_markdown, "md"),
    "csv": (programs.to_csv, "csv"),
    "json": (programs.to_json, "json"),
}


@dataclass(frozen=True, slots=True)
class ReportRequest:
    """What ``harness report`` was asked for.

    Attributes:
        table: Name in ``TABLES``, or ``PUBLISHED_TABLE``.
        format: Name in ``FORMATS``.
        methods: Rows in this order; by default all in the order of the catalogue.
        subjects: Subjects that count; by default all that have a record.
        interval: Whether means carry a 95 % bootstrap interval over subjects.
        published: Whether the paper's printed numbers are shown below.
        paired: Whether ``PUBLISHED_TABLE`` shows differences and not means.
        protocol: Under which ``PUBLISHED_TABLE`` shows what publications print; MExECON's if empty.
        split: Name of the split whose subjects these are, for the caption.
    """

    table: str = "geometry"
    format: str = "markdown"
    methods: tuple[str, ...] | None = None
    subjects: tuple[str, ...] | None = None
    interval: bool = False
    published: bool = False
    paired: bool = False
    protocol: str = ""
    split: str = ""

    def named(self, table: Table) -> Table:
        """The table with the name of the split behind that of its dataset."""
        name = f"{table.dataset} (split {self.split})" if self.split else table.dataset
        return replace(table, dataset=name)


def build_table(
    records: Sequence[Record], request: ReportRequest, before: Sequence[Record] | None = None
) -> str:
    """The table as text in the requested format.

    Args:
        records: Of one run.
        request: What is asked for.
        before: Records that ``PAIRED_TABLE`` compares each method of the run with.

    Raises:
        HarnessError: an unknown table or format, or nothing to report; ``before`` with another
            table.
        ProtocolMismatch: the records are not comparable.
    """
    write = writer_of(request.format)
    return written(_table(records, request, before), write)


def build_published(
    request: ReportRequest, protocol: MetricProtocol | None = None, own: Sequence[Record] = ()
) -> str:
    """The authors' own results as text in the requested format; no run is needed.

    Under a protocol of the field: what publications print, below the records of a run if given.

    Paired differences always carry their interval.

    Raises:
        HarnessError: an unknown format, method or subject, or nothing to compare.
    """
    write = writer_of(request.format)
    if protocol is not None:
        return write(published_under(protocol, own))
    if request.paired:
        table = published_differences(methods=request.methods, subjects=request.subjects)
    else:
        table = published_means(
            methods=request.methods, subjects=request.subjects, intervals=request.interval
        )
    return written(table, write)


def table_of_protocols(store: RunStore, request: ReportRequest) -> Table:
    """Each method of a run under each protocol that its meshes were measured by.

    Raises:
        HarnessError: there are no further protocols, or one was changed under its name.
    """
    records = store.records()
    return table_of_scores(records, scores_of(store, records), request)


def scores_of(store: RunStore, records: Sequence[Record]) -> RunScores:
    """What the meshes of some records of a run score under further protocols, by cell."""
    found = {
        f"{record.method_name}/{record.subject}": ProtocolScores.beside(
            store.cell(record.method_name, record.subject).directory, record.files[MESH_FILE]
        )
        for record in records
        if record.status == "ok" and MESH_FILE in record.files
    }
    return RunScores({cell: scores for cell, scores in found.items() if scores.scores})


def table_of_scores(records: Sequence[Record], scores: RunScores, request: ReportRequest) -> Table:
    """As ``table_of_protocols``, of records and scores that are known."""
    of_cell = {
        (method, subject): each.scores
        for cell, each in scores.cells.items()
        for method, _, subject in [cell.rpartition("/")]
    }
    methods = request.methods or _catalogue_order(records)
    table = protocols_table(records, of_cell, methods=methods, subjects=request.subjects)
    return request.named(table)


def writer_of(form: str) -> Callable[[Table], str]:
    """What writes a table in a format.

    Raises:
        HarnessError: an unknown format.
    """
    write, _ = _known("format", form, FORMATS)
    return write


def written(table: Table, write: Callable[[Table], str]) -> str:
    """A table as text.

    Raises:
        HarnessError: a table without rows.
    """
    if not table.rows:
        raise HarnessError(
            f"no method has the numbers of the table '{table.name}'", got=table.remarks[-1]
        )
    return write(table)


def write_tables(
    records: Sequence[Record], folder: Path, request: ReportRequest = ReportRequest()
) -> list[Path]:
    """Every table in every format as ``<folder>/<table>.<extension>``; returns the files.

    A table that no method has numbers for says so, and has no rows.
    """
    written = []
    for name in TABLES:
        table = _table(records, replace(request, table=name))
        for write, extension in FORMATS.values():
            path = folder / f"{name}.{extension}"
            write_text(path, write(table))
            written.append(path)
    return written


def every_table(
    records: Sequence[Record], subjects: tuple[str, ...] | None = None
) -> tuple[Table, ...]:
    """Every table that some method has numbers for; methods are as in the records.

    Means carry intervals from four subjects on: fewer tell next to nothing of their spread.
    """
    methods = tuple(dict.fromkeys(record.method_name for record in records))
    interval = len({record.subject for record in records}) >= _LEAST_FOR_INTERVALS
    request = ReportRequest(methods=methods, subjects=subjects, interval=interval)
    made = (_table(records, replace(request, table=name)) for name in TABLES)
    return tuple(table for table in made if table.rows)


def _table(
    records: Sequence[Record], request: ReportRequest, before: Sequence[Record] | None = None
) -> Table:
    if before is not None and request.table != PAIRED_TABLE:
        raise HarnessError(
            "--before compares records in the paired table",
            got=f"--table {request.table}",
            hint=f"Use --table {PAIRED_TABLE}",
        )
    if request.table not in TABLES:
        hint = did_you_mean(
            request.table,
            [
                *TABLES,
                PHOTOS_TABLE,
                PHOTO_ERRORS_TABLE,
                SEEDS_TABLE,
                PUBLISHED_TABLE,
                PROTOCOLS_TABLE,
            ],
        )
        raise HarnessError(f"unknown table '{request.table}'", hint=hint)
    if request.paired:
        raise HarnessError(
            "--paired shows differences of the published results",
            got=f"--table {request.table}",
            hint=f"Use --table paired for a run, or --table {PUBLISHED_TABLE} --paired",
        )
    make = TABLES[request.table]
    if before is not None:
        make = functools.partial(change_table, before=before)
    asked = Asked(
        methods=request.methods or _catalogue_order(records),
        subjects=request.subjects,
        interval=bootstrap_ends if request.interval else None,
        published=request.published,
    )
    return request.named(make(records, asked=asked))


def in_order(records: Sequence[Record], methods: tuple[str, ...]) -> list[Record]:
    """The records of some methods in their order; of all methods, in the catalogue's, if empty.

    Raises:
        HarnessError: a method without a record.
    """
    present = dict.fromkeys(record.method_name for record in records)
    for name in methods:
        if name not in present:
            raise HarnessError(f"no record of method '{name}'", hint=did_you_mean(name, present))
    order = methods or _catalogue_order(records)
    return [record for name in order for record in records if record.method_name == name]


def _known(kind: str, name: str, known: Mapping[str, T]) -> T:
    if name not in known:
        raise HarnessError(f"unknown {kind} '{name}'", hint=did_you_mean(name, known))
    return known[name]


def _catalogue_order(records: Sequence[Record]) -> list[str]:
    present = dict.fromkeys(record.method_name for record in records)
    catalogued = [name for name in METHODS if name in present]
    return [*catalogued, *(name for name in present if name not in catalogued)]


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
