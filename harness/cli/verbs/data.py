"""``harness data``: what is measured on, and whether it is there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import (
    Dataset,
    Jobs,
    Json,
    ManifestPath,
    Reason,
    Subjects,
    WorkspacePath,
    split_names,
)  # fmt: skip

__all__ = ["app"]

app = typer.Typer(
    help="List, check and make the data.", no_args_is_help=True, rich_markup_mode=None
)
_MARKS = {"present": "ok", "missing": "MISSING", "corrupt": "CORRUPT"}


@app.command("list")
def list_datasets(
    workspace: WorkspacePath = None, manifest: ManifestPath = None, as_json: Json = False
) -> None:
    """Datasets, splits, recipes and protocols of the manifest."""
    from harness.data.manifest import load_manifest
    from harness.pipeline.inputs.inventory import overview
    from harness.pipeline.inputs.workspace import Workspace

    listing = overview(load_manifest(manifest), Workspace.default(workspace))
    if as_json:
        print(json.dumps(listing, indent=2))
        return
    for kind, entries in listing.items():
        print(f"{kind}:")
        for name, text in entries.items():
            print(f"  {name:20} {text}")


@app.command("check")
def check_dataset(
    dataset: str,
    subjects: Subjects = "",
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """The expected tree of a dataset, with what is present, missing or corrupt."""
    from harness.data.manifest import load_manifest
    from harness.pipeline.inputs.inventory import check_tree
    from harness.pipeline.inputs.workspace import Workspace

    tree = check_tree(
        load_manifest(manifest), Workspace.default(workspace), dataset, split_names(subjects)
    )
    if as_json:
        print(json.dumps(tree.to_dict(), indent=2))
    else:
        print(tree.heading)
        for entry in tree.files:
            print(
                f"  {_MARKS[entry.state]:8} {entry.path}{f'   {entry.note}' if entry.note else ''}"
            )
        print(tree.summary)
    if not tree.complete:
        raise typer.Exit(1)


@app.command("show")
def show(
    subject: str,
    dataset: Dataset = "avatars",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The PNG. Default: SUBJECT.png.")
    ] = None,
    reason: Reason = "",
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
) -> None:
    """A contact sheet of a generated subject: eight views, bare geometry, the body underneath."""
    from harness.cli.display import Bars
    from harness.data.manifest import load_manifest
    from harness.pipeline.inputs.captures import show_avatar
    from harness.pipeline.inputs.sources import Source
    from harness.pipeline.inputs.workspace import Workspace

    checked = load_manifest(manifest)
    recipe = next(iter(checked.recipes))
    source = Source.select(checked, Workspace.default(workspace), dataset, (subject,), recipe)
    print(show_avatar(source, output or Path(f"{subject}.png"), Bars(), reason))


@app.command("make")
def make(
    dataset: str,
    subjects: Subjects = "",
    jobs: Jobs = 1,
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Make a generated dataset; what is there and current is kept."""
    from harness.cli.display import Bars, tell
    from harness.data.manifest import load_manifest
    from harness.pipeline.inputs.captures import make_avatars
    from harness.pipeline.inputs.sources import Source
    from harness.pipeline.inputs.workspace import Workspace

    checked = load_manifest(manifest)
    source = Source.select(
        checked,
        Workspace.default(workspace),
        dataset,
        split_names(subjects),
        next(iter(checked.recipes)),
    )
    with Bars(quiet=as_json) as bars:
        outcomes = make_avatars(source, jobs, bars)
    tell(outcomes, as_json=as_json)
