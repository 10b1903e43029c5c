"""``harness report --page``: a run's records, photos and surfaces become a page of files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import HarnessError
from harness.core.records import Record
from harness.data.manifest import SHAREABLE, Dataset, Manifest
from harness.pipeline.inputs.scan_set import ScanSet
from harness.pipeline.inputs.sealed import Look, admit
from harness.pipeline.inputs.sources import Source
from harness.pipeline.inputs.workspace import Workspace
from harness.pipeline.progress import Progress
from harness.pipeline.report.page_head import opening_methods, page_facts, page_lead
from harness.pipeline.report.page_subjects import SubjectWriter
from harness.pipeline.report.tables import every_table, in_order
from harness.pipeline.run.store import RunStore
from reports.page.folder import page_folder
from reports.page.methods import page_methods
from reports.page.model import PageModel


@dataclass(frozen=True, slots=True)
class PageRequest:
    """What ``harness report --page`` was asked for.

    Attributes:
        store: The run.
        directory: The folder to write; an older page there is replaced.
        methods: Rows of tables in this order; all if empty.
        subjects: Subjects that count; all that have a record if empty.
        surfaces: Methods whose surfaces can be looked at; those of ``methods`` if empty.
        include_licensed: Whether a dataset that may not be passed on is shown all the same.
        reason: Why sealed subjects are looked at; needed for these only.
    """

    store: RunStore
    directory: Path
    methods: tuple[str, ...] = ()
    subjects: tuple[str, ...] = ()
    surfaces: tuple[str, ...] = ()
    include_licensed: bool = False
    reason: str = ""


def write_page(
    request: PageRequest,
    manifest: Manifest,
    workspace: Workspace,
    progress: Progress,
    records: Sequence[Record] | None = None,
) -> Path:
    """The page's ``index.html``, written now together with everything that it shows.

    Args:
        request: What is wanted.
        manifest: Where the records' dataset is described.
        workspace: Where scans and photos lie.
        progress: Hears of every surface.
        records: Only these of the run's; all by default.

    Raises:
        HarnessError: nothing to show, a licence that does not allow it, sealed subjects without a
            reason, or a folder that holds something else.
        ProtocolMismatch: records that are not comparable.
        DataError: a scan, photo or mesh that is not there or is another one.
    """
    chosen = _chosen(request, request.store.records() if records is None else records)
    name = chosen[0].dataset
    dataset = manifest.select(name)[1]
    _check_licence(name, dataset, include=request.include_licensed)
    seen = in_order(chosen, request.surfaces)
    present = {record.subject for record in chosen}
    subjects = tuple(subject for subject in dataset.subjects if subject in present)
    recipe = next((record.recipe for record in chosen if record.recipe), "")
    shown = tuple(dict.fromkeys(record.method_name for record in seen))
    look = Look("page", name, subjects, request.reason, shown, recipe)
    admit(manifest, workspace, look, progress)
    tables, methods = every_table(chosen, request.subjects or None), page_methods(chosen)
    writer = SubjectWriter(
        store=request.store,
        records=tuple(seen),
        scans=ScanSet.select(manifest, workspace, name, subjects),
        photos=Source.select(manifest, workspace, name, subjects, recipe) if recipe else None,
        opening=opening_methods(tables, methods, shown),
        progress=progress,
    )
    with page_folder(request.directory) as folder:
        made = writer.write_all(folder)
        folder.finish(
            PageModel(
                title=request.store.directory.name,
                lead=page_lead(chosen, dataset, made),
                facts=page_facts(chosen, dataset),
                tables=tables,
                methods=methods,
                subjects=made,
                scalars=writer.scalars(),
                opening=writer.opening,
                records=tuple(chosen),
            )
        )
    return request.directory / "index.html"


def _chosen(request: PageRequest, records: Sequence[Record]) -> list[Record]:
    """The records that count, by method in order."""
    if not records:
        raise HarnessError(
            f"{request.store.directory} has no record to show", hint="Run 'harness eval' first"
        )
    ordered = in_order(records, request.methods)
    chosen = [
        record for record in ordered if not request.subjects or record.subject in request.subjects
    ]
    if missing := set(request.subjects) - {record.subject for record in chosen}:
        raise HarnessError(f"no record of {', '.join(sorted(missing))} in this run")
    return chosen


def _check_licence(name: str, dataset: Dataset, *, include: bool) -> None:
    """Refuse to put scans and photos into a folder made for sharing where that is not allowed."""
    if include or dataset.may_be_passed_on:
        return
    raise HarnessError(
        f"a page holds the scans and photos of dataset '{name}' and is made to be passed on, which "
        "their licence does not allow",
        expected=f"a licence such as {', '.join(SHAREABLE)}",
        got=dataset.licence,
        hint="For your own eyes add --include-licensed, and give the folder to nobody whom the "
        "licence does not cover",
    )
