"""``harness quickstart``: from two generated avatars to tables, pictures and a page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import HarnessError
from harness.data.manifest import Manifest
from harness.pipeline.inputs.sources import Source
from harness.pipeline.inputs.workspace import Workspace
from harness.pipeline.progress import Progress
from harness.pipeline.report.figures import FIGURES
from harness.pipeline.report.page import PageRequest, write_page
from harness.pipeline.report.tables import ReportRequest, build_table, in_order, write_tables
from harness.pipeline.run.chosen_method import catalogued_methods
from harness.pipeline.run.evaluate import EvalSummary, evaluate
from harness.pipeline.run.plan import EvalRequest
from harness.pipeline.run.store import RunStore

_FIGURES = "figures"
_SPLIT, _RECIPE, _PROTOCOL, _RUN = "avatars-tiny", "quick8", "mexecon", "quickstart"

#: Methods in the figures and on the page: all of them side by side would be too small to see.
_DRAWN = ("hull8", "econ", "mexecon2", "mexecon8", "mexecon+")
_DRAWN_BODIES = ("body-front", "body-average", "jmbo8", "jmbo8+")
#: Methods without a row, which would repeat another's: on eight photos ``hull`` is ``hull8``.
_REPEATED = ("hull",)


@dataclass(frozen=True, slots=True)
class QuickstartResult:
    """What the quickstart made.

    Attributes:
        summary: All records.
        tables: The geometry and the cost table as Markdown.
        files: Tables in every format and the figures, as written.
        page: The page's ``index.html``; None if it was not written, which ``unavailable`` explains.
        unavailable: Methods that could not be run and figures not drawn, with the reason.
    """

    summary: EvalSummary
    tables: tuple[str, ...]
    files: tuple[Path, ...]
    unavailable: tuple[str, ...]
    page: Path | None


def quickstart(
    manifest: Manifest, workspace: Workspace, progress: Progress, jobs: int
) -> QuickstartResult:
    """Make two avatars, photograph them, run every method that can be, and write tables."""
    catalogued = catalogued_methods()
    lacking = {**catalogued.failures, **catalogued.missing}
    unavailable = [f"{name}: {error}" for name, error in lacking.items()]
    left_out = {*lacking, *_REPEATED}
    methods = tuple(method for method in catalogued.usable if method.name not in left_out)
    names = {method.name for method in methods}
    store = RunStore(workspace.run(_RUN))
    request = EvalRequest(
        source=Source.select(manifest, workspace, _SPLIT, (), _RECIPE),
        methods=methods,
        protocol=manifest.protocol(_PROTOCOL),
        store=store,
        jobs=jobs,
    )
    summary = evaluate(request, progress)
    # Records of this request alone: the folder may hold cells of methods that are gone.
    records = list(summary.records)
    folder = store.directory / "tables"
    files = write_tables(records, folder)
    figures: list[Path] = []
    undrawn: list[str] = []
    progress.expect(_FIGURES, len(FIGURES))
    for name, draw in FIGURES.items():
        drawn = _DRAWN_BODIES if name == "bodies" else _DRAWN
        shown = in_order(records, tuple(method for method in drawn if method in names))
        try:
            figures.append(draw(store, request.source, shown, folder / f"{name}.png"))
        except HarnessError as error:
            undrawn.append(f"figure {name}: {error}")
        progress.done(_FIGURES)
    tables = tuple(
        build_table(records, ReportRequest(table=table)) for table in ("geometry", "cost")
    )
    surfaces = tuple(method for method in _DRAWN if method in names)
    wanted = PageRequest(store, store.directory / "page", surfaces=surfaces)
    page: Path | None = None
    try:
        page = write_page(wanted, manifest, workspace, progress, records)
    except HarnessError as error:
        undrawn.append(f"page: {error}")
    return QuickstartResult(summary, tables, (*files, *figures), (*unavailable, *undrawn), page)
