"""``harness report --figure``: which records are drawn, and into which file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import HarnessError, did_you_mean
from harness.core.records import Record
from harness.data.manifest import Manifest
from harness.pipeline.inputs.sealed import Look, admit
from harness.pipeline.inputs.sources import Source
from harness.pipeline.inputs.workspace import Workspace
from harness.pipeline.progress import Progress
from harness.pipeline.report.figures import FIGURES
from harness.pipeline.report.tables import in_order
from harness.pipeline.run.store import RunStore


@dataclass(frozen=True, slots=True)
class FigureRequest:
    """What ``harness report --figure`` was asked for.

    Attributes:
        name: Name in ``FIGURES``.
        store: The run.
        methods: Methods in this order; all if empty.
        subjects: Subjects in this order; all that have been photographed if empty.
        reason: Why sealed subjects are drawn; needed for these only.
        output: The file to write; by default named after the figure, in the run's folder.
    """

    name: str
    store: RunStore
    methods: tuple[str, ...] = ()
    subjects: tuple[str, ...] = ()
    reason: str = ""
    output: Path | None = None


def draw_figure(
    request: FigureRequest, manifest: Manifest, workspace: Workspace, progress: Progress
) -> Path:
    """The file of a figure that is drawn now; a look at sealed subjects is logged before.

    Raises:
        HarnessError: an unknown figure, nothing to draw, or sealed subjects without a reason.
    """
    if request.name not in FIGURES:
        raise HarnessError(
            f"unknown figure '{request.name}'", hint=did_you_mean(request.name, FIGURES)
        )
    records = in_order(request.store.records(), request.methods)
    source = _source(request, records, manifest, workspace)
    methods = tuple(dict.fromkeys(record.method_name for record in records))
    what = f"figure {request.name}"
    look = Look(what, source.name, source.subjects, request.reason, methods, source.recipe_name)
    admit(manifest, workspace, look, progress)
    path = request.output or request.store.directory / f"{request.name}.png"
    return FIGURES[request.name](request.store, source, records, path)


def _source(
    request: FigureRequest, records: Sequence[Record], manifest: Manifest, workspace: Workspace
) -> Source:
    """The photographed subjects of some records, or those asked for."""
    photographed = [record for record in records if record.recipe]
    if not photographed:
        raise HarnessError(
            f"{request.store.directory} has no record of photos", hint="Run 'harness eval'"
        )
    first = photographed[0]
    subjects = request.subjects or tuple(dict.fromkeys(record.subject for record in photographed))
    return Source.select(manifest, workspace, first.dataset, subjects, first.recipe)
