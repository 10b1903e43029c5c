"""``harness report``: records as a table, a figure or a page."""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated

import typer

from harness.cli import options as opt
from harness.cli.display import deliver, how_to_open, shown_progress
from harness.cli.options import split_names
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError
from harness.core.protocol_scores import RunScores
from harness.data.manifest import load_manifest
from harness.report.figures import FIGURES, FigureRequest, draw_figure
from harness.report.page import PageRequest, write_page
from harness.report.seeds import table_of_seeds
from harness.report.tables import (
    FORMATS,
    PAIRED_TABLE,
    PHOTO_TABLES,
    PROTOCOLS_TABLE,
    PUBLISHED_TABLE,
    SEEDS_TABLE,
    TABLES,
    PhotoReport,
    ReportRequest,
    build_photo_table,
    build_published,
    build_table,
    table_of_protocols,
    table_of_scores,
    writer_of,
    written,
)
from harness.run.frames import read_record_file
from harness.run.sources import refuse_both
from harness.run.store import RunStore
from harness.run.workspace import Workspace

_OF_TABLES = (
    "--table",
    "--format",
    "--json",
    "--interval",
    "--published",
    "--paired",
    "--protocol",
)
_OF_PAGES = ("--surfaces", "--include-licensed")


def given_options(context: typer.Context) -> frozenset[str]:
    """The options that the command line has, such as ``--table``."""
    found = set()
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if source is not None and source.name == "COMMANDLINE":
            found |= {name for name in parameter.opts if name.startswith("--")}
    return frozenset(found)


def refuse_ignored(given: Collection[str], table: str, figure: str, page: Path | None) -> None:
    """Refuse options that take no part in what is made.

    Raises:
        HarnessError: it names the first of them.
    """
    if page is not None:
        kind, ignored = "--page", (*_OF_TABLES, "--output", "--figure")
    elif figure:
        kind, ignored = "--figure", (*_OF_TABLES, *_OF_PAGES)
    elif table in PHOTO_TABLES:
        kind, ignored = f"--table {table}", ("--published", "--paired", *_OF_PAGES)
    elif table in (SEEDS_TABLE, PROTOCOLS_TABLE):
        kind, ignored = f"--table {table}", ("--published", "--paired", "--interval", *_OF_PAGES)
    elif table == PUBLISHED_TABLE:
        needless = () if "--protocol" in given else ("--run", "--split")
        ignored = (*needless, "--reason", "--published", *_OF_PAGES)
        kind = f"--table {table}, which needs no run"
    else:
        kind, ignored = "a table", ("--protocol", *_OF_PAGES)
    if table in (*PHOTO_TABLES, SEEDS_TABLE, PROTOCOLS_TABLE):
        ignored = (*ignored, "--protocol")
    for option in ignored:
        if option in given:
            hint = f"Leave {option} out"
            raise HarnessError(f"{option} cannot be combined with {kind}", hint=hint)


def refuse_with_records(
    records: Path | None, run: str | None, table: str, figure: str, page: Path | None
) -> None:
    """Refuse what a file of records, if one is given, cannot give.

    Raises:
        HarnessError: there is some.
    """
    if records is None:
        return
    other = {"--run": run, "--figure": figure, "--page": page}
    given = [option for option, value in other.items() if value]
    if table not in (*TABLES, PROTOCOLS_TABLE):
        given.append(f"--table {table}")
    if given:
        raise HarnessError(
            f"--records cannot be combined with {given[0]}",
            expected=f"a table of the records alone: {', '.join(TABLES)}",
            hint="Figures, pages and photo tables need a run: leave out --records",
        )


def refuse_with_before(before: Path | None, figure: str, page: Path | None) -> None:
    """Refuse pictures of a comparison with other records.

    Raises:
        HarnessError: there is one.
    """
    if before is not None and (figure or page):
        raise HarnessError(
            f"--before cannot be combined with {'--figure' if figure else '--page'}",
            expected=f"--table {PAIRED_TABLE}",
        )


app = verb_group("report")

TableName = Annotated[
    str,
    typer.Option(
        "--table",
        metavar="NAME",
        help=f"Table to print: {', '.join(TABLES)}; {' or '.join(PHOTO_TABLES)}, quality without "
        "a scan, measured now where it is not stored, and how it goes with the errors; "
        f"{SEEDS_TABLE}, the spread over the seeds of 'harness eval --seeds'; {PROTOCOLS_TABLE}, "
        "number and rank under each protocol of 'harness eval --protocol A,B'; or "
        f"{PUBLISHED_TABLE}, the results that the paper's authors released, which needs no run.",
    ),
]
Format = Annotated[
    str, typer.Option("--format", metavar="FORMAT", help=f"One of {', '.join(FORMATS)}.")
]
Interval = Annotated[
    bool,
    typer.Option("--interval", help="Show a 95 % interval of each mean (bootstrap over subjects)."),
]
Published = Annotated[
    bool,
    typer.Option("--published", help="Show the numbers printed in the paper below the run's own."),
]
Paired = Annotated[
    bool,
    typer.Option(
        "--paired",
        help=f"With --table {PUBLISHED_TABLE}: show differences between methods on the same "
        "subjects.",
    ),
]
PrintedUnder = Annotated[
    str,
    typer.Option(
        "--protocol",
        metavar="NAME",
        help=f"With --table {PUBLISHED_TABLE}: what publications print under a protocol of the "
        "field; with --run, below the rows of a run that was measured by it.",
    ),
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="File to write. Default: print a table; write a figure into the run's folder.",
    ),
]
Figure = Annotated[
    str,
    typer.Option(
        "--figure",
        metavar="NAME",
        help=f"Draw a figure instead of a table: {', '.join(FIGURES)}.",
    ),
]

Page = Annotated[
    Path | None,
    typer.Option(
        "--page",
        metavar="FOLDER",
        help="Write a page with all tables, photos and surfaces that turn. It opens from its files "
        "without a network.",
    ),
]
Surfaces = Annotated[
    str,
    typer.Option(
        "--surfaces",
        metavar="NAMES",
        help="With --page: methods whose surfaces can be looked at, comma-separated. Default: all "
        "that the tables show.",
    ),
]
IncludeLicensed = Annotated[
    bool,
    typer.Option(
        "--include-licensed",
        help="With --page: include scans and photos whose licence does not let you pass them on.",
    ),
]
RecordFile = Annotated[
    Path | None,
    typer.Option(
        "--records",
        metavar="FILE",
        help="Read records from a file of 'harness results records', not from a run. For tables "
        "that need no meshes or photos.",
    ),
]

Before = Annotated[
    Path | None,
    typer.Option(
        "--before",
        metavar="FILE",
        help=f"With --table {PAIRED_TABLE}: compare each method with itself in this file of "
        "'harness results records', such as with another network or of an earlier version.",
    ),
]


@app.command()
def report(
    context: typer.Context,
    table: TableName = "geometry",
    form: Format = "markdown",
    run: opt.Run = None,
    records: RecordFile = None,
    before: Before = None,
    method: opt.MethodsToShow = "",
    subjects: opt.Subjects = "",
    split: opt.SplitName = "",
    interval: Interval = False,
    published: Published = False,
    paired: Paired = False,
    protocol: PrintedUnder = "",
    output: Output = None,
    figure: Figure = "",
    page: Page = None,
    surfaces: Surfaces = "",
    include_licensed: IncludeLicensed = False,
    reason: opt.Reason = "",
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Print a table of a run, draw a figure, or write a page."""
    place = Workspace.default(workspace)
    refuse_with_records(records, run, table, figure, page)
    refuse_with_before(before, figure, page)
    refuse_ignored(given_options(context), table, figure, page)
    refuse_both(subjects, split)
    chosen = _of_split(split, place, run, records, manifest) if split else split_names(subjects)
    if page is not None:
        wanted = PageRequest(
            store=RunStore.existing(place, run),
            directory=page.resolve(),
            methods=split_names(method),
            subjects=chosen,
            surfaces=split_names(surfaces),
            include_licensed=include_licensed,
            reason=reason,
        )
        with shown_progress() as progress:
            return print(how_to_open(write_page(wanted, load_manifest(manifest), place, progress)))
    if figure:
        store, rows = RunStore.existing(place, run), split_names(method)
        drawing = FigureRequest(figure, store, rows, chosen, reason, output)
        return print(draw_figure(drawing, load_manifest(manifest), place, shown_progress()))
    request = ReportRequest(
        table,
        "json" if as_json else form,
        split_names(method) or None,
        chosen or None,
        interval=interval,
        published=published,
        paired=paired,
        protocol=protocol,
        split=split,
    )
    return deliver(_text(request, place, run, records, before, manifest, reason), output)


def _of_split(
    split: str, place: Workspace, run: str | None, file: Path | None, manifest: Path | None
) -> tuple[str, ...]:
    """The subjects of a split of the one dataset that the records are of."""
    records = read_record_file(file) if file else RunStore.existing(place, run).records()
    found = sorted({record.dataset for record in records})
    if len(found) != 1:
        raise HarnessError("--split is of one dataset", got=", ".join(found) or "no records")
    return load_manifest(manifest).split(found[0], split)


def _text(
    request: ReportRequest,
    place: Workspace,
    run: str | None,
    records: Path | None,
    before: Path | None,
    manifest: Path | None,
    reason: str,
) -> str:
    """The table that was asked for."""
    whole = request.methods or ()
    if records is not None or before is not None:
        if records:
            now = read_record_file(records, whole)
            if request.table == PROTOCOLS_TABLE:
                scores = RunScores.beside(records)
                return written(table_of_scores(now, scores, request), writer_of(request.format))
        else:
            now = RunStore.existing(place, run).records(whole)
        return build_table(now, request, read_record_file(before, whole) if before else None)
    if request.table == PUBLISHED_TABLE:
        rule = load_manifest(manifest).protocol(request.protocol) if request.protocol else None
        own = RunStore.existing(place, run).records() if rule and run else ()
        return build_published(request, rule, own)
    store = RunStore.existing(place, run)
    if request.table in (PROTOCOLS_TABLE, SEEDS_TABLE):
        if request.table == PROTOCOLS_TABLE:
            found = table_of_protocols(store, request)
        else:
            found = request.named(table_of_seeds(store, request.methods, request.subjects))
        return written(found, writer_of(request.format))
    if request.table not in PHOTO_TABLES:
        return build_table(store.records(whole), request)
    wanted = PhotoReport(request, store, load_manifest(manifest), place, reason)
    with shown_progress() as progress:
        return build_photo_table(wanted, progress)
