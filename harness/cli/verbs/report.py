"""``harness report``: records as a table or a figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import (
    Json,
    ManifestPath,
    Reason,
    Run,
    Subjects,
    WorkspacePath,
    split_names,
)
from harness.core.errors import HarnessError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from harness.core.records import Record
    from harness.pipeline.inputs.sources import Source
    from harness.pipeline.inputs.workspace import Workspace
    from harness.pipeline.report.tables import ReportRequest
    from harness.pipeline.run.store import RunStore

__all__ = ["report"]


def report(
    table: Annotated[
        str,
        typer.Option("--table", help="geometry, paired, cost, jmbo, regions, normals, published."),
    ] = "geometry",
    form: Annotated[
        str, typer.Option("--format", help="markdown, latex, csv or json.")
    ] = "markdown",
    run: Run = None,
    method: Annotated[
        str, typer.Option("--method", help="These methods, in this order. Default: all.")
    ] = "",
    subjects: Subjects = "",
    interval: Annotated[
        bool, typer.Option("--interval", help="Bootstrap 95 % interval over subjects.")
    ] = False,
    published: Annotated[
        bool, typer.Option("--published", help="The paper's own numbers, as a marked block.")
    ] = False,
    paired: Annotated[
        bool, typer.Option("--paired", help="With --table published: differences by subject.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write to this file.")
    ] = None,
    figure: Annotated[
        str,
        typer.Option(
            "--figure", help="A figure instead: qualitative, overlay, bodies, failures or normals."
        ),
    ] = "",
    reason: Reason = "",
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Print a table of a run's records or of the published results, or draw a figure of a run."""
    from harness.pipeline.inputs.workspace import Workspace
    from harness.pipeline.report.tables import ReportRequest, in_order
    from harness.pipeline.run.store import RunStore

    place = Workspace.default(workspace)
    if figure:
        store = RunStore.existing(place, run)
        draw = _figure(figure)
        records = in_order(store.records(), split_names(method))
        source = _source(store, records, place, manifest, split_names(subjects))
        _admit(figure, source, records, reason)
        print(draw(store, source, records, output or store.directory / f"{figure}.png"))
        return
    request = ReportRequest(
        table=table,
        format="json" if as_json else form,
        methods=split_names(method) or None,
        subjects=split_names(subjects) or None,
        interval=interval,
        published=published,
        paired=paired,
    )
    _deliver(_text(request, place, run), output)


def _text(request: ReportRequest, place: Workspace, run: str | None) -> str:
    """The table; only the published one needs no run."""
    from harness.pipeline.report.tables import PUBLISHED_TABLE, build_published, build_table
    from harness.pipeline.run.store import RunStore

    if request.table == PUBLISHED_TABLE:
        return build_published(request)
    return build_table(RunStore.existing(place, run).records(), request)


def _deliver(text: str, output: Path | None) -> None:
    """Print the text, or write it and print the file's name."""
    from harness.core.files.atomic import write_text

    if output is None:
        print(text, end="" if text.endswith("\n") else "\n")
    else:
        write_text(output, text)
        print(output)


def _figure(name: str) -> Callable[[RunStore, Source, Sequence[Record], Path], Path]:
    from harness.pipeline.report.figures import FIGURES

    if name not in FIGURES:
        raise HarnessError(f"unknown figure '{name}'", hint=did_you_mean(name, FIGURES))
    return FIGURES[name]


def _admit(figure: str, source: Source, records: Sequence[Record], reason: str) -> None:
    """Figures of sealed subjects need a reason and are logged."""
    from harness.cli.display import Bars
    from harness.pipeline.inputs.sealed import Look, admit

    methods = tuple(dict.fromkeys(record.method_name for record in records))
    look = Look(
        f"figure {figure}", source.name, source.subjects, reason, methods, source.recipe.name
    )
    admit(source.manifest, source.workspace, look, Bars())


def _source(
    store: RunStore,
    records: Sequence[Record],
    place: Workspace,
    manifest: Path | None,
    subjects: tuple[str, ...],
) -> Source:
    """The photographed subjects of some records, or those asked for."""
    from harness.data.manifest import load_manifest
    from harness.pipeline.inputs.sources import Source

    photographed = [record for record in records if record.recipe]
    if not photographed:
        raise HarnessError(f"{store.directory} has no record of photos", hint="Run 'harness eval'")
    first = photographed[0]
    chosen = subjects or tuple(dict.fromkeys(record.subject for record in photographed))
    return Source.select(load_manifest(manifest), place, first.dataset, chosen, first.recipe)
