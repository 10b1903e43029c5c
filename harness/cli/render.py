"""``harness render``: photos of subjects, with the proof of their cameras."""

from __future__ import annotations

import json

import typer

from harness.cli.options import (
    Dataset,
    Jobs,
    Json,
    ManifestPath,
    Recipe,
    Subjects,
    WorkspacePath,
    split_names,
)  # fmt: skip

__all__ = ["render"]


def render(
    dataset: Dataset = "avatars",
    subjects: Subjects = "",
    recipe: Recipe = "paper8",
    jobs: Jobs = 1,
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Render calibrated RGBA photos of subjects; what is there and current is kept."""
    from harness.cli.display import Bars
    from harness.data.manifest import load_manifest
    from harness.pipeline.captures import render_all
    from harness.pipeline.sources import Source
    from harness.pipeline.workspace import Workspace

    source = Source.select(
        load_manifest(manifest),
        Workspace.default(workspace),
        dataset,
        split_names(subjects),
        recipe,
    )
    with Bars(quiet=as_json) as bars:
        outcomes = render_all(source, jobs, bars)
    if as_json:
        print(json.dumps([outcome.to_dict() for outcome in outcomes], indent=2))
    else:
        for outcome in outcomes:
            print(outcome)
    if any(outcome.failure for outcome in outcomes):
        raise typer.Exit(1)
