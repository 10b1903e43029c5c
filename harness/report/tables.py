"""``harness report``: the records of a run become a table in the format asked for."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from harness.core.errors import HarnessError, did_you_mean
from harness.core.files.atomic import write_text
from harness.core.protocol_scores import ProtocolScores, RunScores
from harness.core.records import Record
from harness.core.settings import MetricProtocol
from harness.run.publication import MESH_FILE
from harness.run.store import RunStore
from methods.catalog import METHODS
from reports.formats.latex import to_latex
from reports.formats.markdown import to_markdown
from reports.formats.programs import to_csv, to_json
from reports.published.field import published_under
from reports.published.table import published_differences, published_means
from reports.statistics import bootstrap_ends
from reports.tables.cameras import cameras_table
from reports.tables.cost import cost_table
from reports.tables.geometry import geometry_table
from reports.tables.jmbo import jmbo_table
from reports.tables.normals import normals_table
from reports.tables.paired import change_table, paired_table
from reports.tables.protocols import protocols_table
from reports.tables.regions import regions_table
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
    "csv": (to_csv, "csv"),
    "json": (to_json, "json"),
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
    made = make(
        records,
        methods=request.methods or _catalogue_order(records),
        subjects=request.subjects,
        interval=bootstrap_ends if request.interval else None,
        published=request.published,
    )
    return request.named(made)


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
