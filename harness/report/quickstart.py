"""``harness quickstart``: from two generated avatars to tables, pictures and a page."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.core.errors import HarnessError
from harness.core.process.forks import serving
from harness.core.records import Record
from harness.data.manifest import Manifest
from harness.report.figures import FIGURES
from harness.report.page import PageRequest, write_page
from harness.report.tables import ReportRequest, build_table, in_order, write_tables
from harness.run.evaluate import EvalSummary, evaluate
from harness.run.method_choice import catalogued_methods
from harness.run.plan import EvalRequest
from harness.run.progress import Progress
from harness.run.sources import Source
from harness.run.store import Outcome, RunStore
from harness.run.workspace import Workspace

_FIGURES = "figures"
_SPLIT, _RECIPE, _PROTOCOL, _RUN = "avatars-tiny", "quick8", "mexecon", "quickstart"

#: Methods of a first look, the quickest first, and the one that is run on the first avatar alone:
#: it takes longer than all others together.
FIRST, _ON_ONE = ("hull8", "econ", "mexecon8", "mexecon+"), "mexecon+"
#: The figure of a first look, of the first avatar.
_FIRST_FIGURES = ("qualitative",)
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
    manifest: Manifest, workspace: Workspace, progress: Progress, jobs: int, *, every: bool = False
) -> QuickstartResult:
    """Make two avatars, photograph them, run methods, and write tables, figures and a page.

    Args:
        manifest: What is measured.
        workspace: Where results go.
        progress: Receives the table after each method, too.
        jobs: Subjects worked on at once.
        every: Run all methods that can be, and not just those of a first look.
    """
    catalogued = catalogued_methods()
    lacking = {**catalogued.failures, **catalogued.missing}
    unavailable = [f"{name}: {error}" for name, error in lacking.items() if every or name in FIRST]
    usable = {each.name: each for each in catalogued.usable if each.name not in lacking}
    chosen = [name for name in usable if name not in _REPEATED] if every else FIRST
    store = RunStore(workspace.run(_RUN))
    request = EvalRequest(
        source=Source.select(manifest, workspace, _SPLIT, (), _RECIPE),
        methods=tuple(usable[name] for name in chosen if name in usable),
        protocol=manifest.protocol(_PROTOCOL),
        store=store,
        jobs=jobs,
    )
    with serving(wanted=True):
        summary = evaluate(request, progress) if every else _one_by_one(request, progress)
    # Records of this request alone: the folder may hold cells of methods that are gone.
    records = list(summary.records)
    files = write_tables(records, store.directory / "tables")
    drawn = request if every else replace(request, source=_first(request.source))
    figures, undrawn = _figures(drawn, records, progress, FIGURES if every else _FIRST_FIGURES)
    wanted = PageRequest(store, store.directory / "page", surfaces=_among(_DRAWN, request))
    page: Path | None = None
    try:
        page = write_page(wanted, manifest, workspace, progress, records)
    except HarnessError as error:
        undrawn.append(f"page: {error}")
    tables = tuple(_table(records, name) for name in ("geometry", "cost"))
    return QuickstartResult(summary, tables, (*files, *figures), (*unavailable, *undrawn), page)


def _one_by_one(request: EvalRequest, progress: Progress) -> EvalSummary:
    """Evaluate method after method, and show the table of those that are done after each."""
    outcomes: list[Outcome] = []
    for method in request.methods:
        source = _first(request.source) if method.name == _ON_ONE else request.source
        own = replace(request, methods=(method,), source=source)
        outcomes += evaluate(own, progress).outcomes
        progress.say(f"\n{_table([outcome.record for outcome in outcomes], 'geometry')}")
    return EvalSummary(tuple(outcomes))


def _first(source: Source) -> Source:
    return source.only(source.subjects[0])


def _figures(
    request: EvalRequest, records: Sequence[Record], progress: Progress, wanted: Iterable[str]
) -> tuple[list[Path], list[str]]:
    """Figures of methods that were run, and why some of them could not be drawn."""
    figures: list[Path] = []
    undrawn: list[str] = []
    methods = {
        name: _among(_DRAWN_BODIES if name == "bodies" else _DRAWN, request) for name in wanted
    }
    progress.expect(_FIGURES, len(methods))
    for name, drawn in methods.items():
        path = request.store.directory / "tables" / f"{name}.png"
        try:
            shown = in_order(records, drawn)
            figures.append(FIGURES[name](request.store, request.source, shown, path))
        except HarnessError as error:
            undrawn.append(f"figure {name}: {error}")
        progress.done(_FIGURES)
    return figures, undrawn


def _among(names: Sequence[str], request: EvalRequest) -> tuple[str, ...]:
    run = {method.name for method in request.methods}
    return tuple(name for name in names if name in run)


def _table(records: Sequence[Record], name: str) -> str:
    return build_table(records, ReportRequest(table=name))
