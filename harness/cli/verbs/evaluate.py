"""``harness eval``: reconstruct and score."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import (
    Dataset,
    Jobs,
    Json,
    ManifestPath,
    Protocol,
    Reason,
    Recipe,
    Set,
    Subjects,
    Timeout,
    WorkspacePath,
    limit_s,
    parsed_settings,
    split_names,
)  # fmt: skip

if TYPE_CHECKING:
    from harness.pipeline.run.plan import EvalRequest

__all__ = ["evaluate"]


def evaluate(
    method: Annotated[str, typer.Option("--method", help="Methods, comma-separated.")],
    dataset: Dataset = "avatars",
    subjects: Subjects = "",
    recipe: Recipe = "paper8",
    protocol: Protocol = "mexecon",
    run: Annotated[str, typer.Option("--run", help="Run folder.")] = "main",
    settings: Set = None,
    seed: Annotated[int, typer.Option("--seed", help="Root of all randomness.")] = 0,
    jobs: Jobs = 1,
    keep: Annotated[
        bool,
        typer.Option(
            "--keep",
            help="Keep intermediate results: normal maps, sheets, a contact sheet of the stages.",
        ),
    ] = False,
    reason: Reason = "",
    timeout: Timeout = 3600.0,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only show what would run.")] = False,
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Render what is missing, reconstruct, score and file records; resume is the default.

    A record is made again when anything that its numbers depend on changed: photos, scan, true
    body and labels, the code that is really used, the packages that it imports, settings, protocol
    or seed; --dry-run says what. A failure that is not the method's never replaces a good record.
    Ctrl-C stops at once and files nothing half done (exit code 130).
    """
    from harness.data.manifest import load_manifest
    from harness.pipeline.inputs.sources import Source
    from harness.pipeline.inputs.workspace import Workspace
    from harness.pipeline.run.chosen_method import chosen_methods
    from harness.pipeline.run.plan import EvalRequest
    from harness.pipeline.run.store import RunStore

    checked = load_manifest(manifest)
    place = Workspace.default(workspace)
    request = EvalRequest(
        source=Source.select(checked, place, dataset, split_names(subjects), recipe),
        methods=chosen_methods(split_names(method), parsed_settings(settings)),
        protocol=checked.protocol(protocol),
        store=RunStore(place.run(run)),
        seed=seed,
        jobs=jobs,
        keep=keep,
        reason=reason,
        timeout_s=limit_s(timeout),
    )
    if dry_run:
        _show_plan(request, as_json=as_json)
    else:
        _run(request, as_json=as_json)


def _show_plan(request: EvalRequest, *, as_json: bool) -> None:
    from harness.cli.display import Bars
    from harness.pipeline.inputs.sealed import announce
    from harness.pipeline.run.plan import plan

    announce(request.source.manifest, request.source.name, Bars())
    cells = plan(request)
    if as_json:
        print(json.dumps([cell.to_dict() for cell in cells], indent=2))
        return
    for cell in cells:
        print(f"{cell.method:16} {cell.subject:10} {cell.state:7} {cell.why}")
    waiting = sum(cell.state == "run" for cell in cells)
    print(f"{waiting} of {len(cells)} cells would run")


def _run(request: EvalRequest, *, as_json: bool) -> None:
    from harness.cli.display import Bars
    from harness.pipeline.run.evaluate import evaluate as carry_out

    with Bars(quiet=as_json) as bars:
        summary = carry_out(request, bars)
    counts = dict(summary.counts)
    if as_json:
        document = {"run": str(request.store.directory), "counts": counts, "cached": summary.cached}
        document["records"] = [record.to_dict() for record in summary.records]
        document["stale"] = [
            {"method": kept.record.method_name, "subject": kept.record.subject, "why": kept.kept}
            for kept in summary.outcomes
            if kept.kept
        ]
        print(json.dumps(document, indent=2))
    else:
        told = ", ".join(f"{number} {status}" for status, number in counts.items())
        print(f"{told} ({summary.cached} cached) in {request.store.directory}")
        print(f"Next: harness report --table geometry --run {request.store.directory.name}")
    if counts.get("ok", 0) < len(summary.records):
        raise typer.Exit(1)
