"""``harness render``: photos of subjects, with the proof of their cameras."""

from __future__ import annotations

from harness.cli.options import (
    Dataset,
    Jobs,
    Json,
    ManifestPath,
    Recipe,
    Subjects,
    Timeout,
    WorkspacePath,
    limit_s,
    split_names,
)  # fmt: skip

__all__ = ["render"]


def render(
    dataset: Dataset = "avatars",
    subjects: Subjects = "",
    recipe: Recipe = "paper8",
    jobs: Jobs = 1,
    timeout: Timeout = 3600.0,
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Render calibrated RGBA photos of subjects; what is there and current is kept."""
    from harness.cli.display import Bars, tell
    from harness.data.manifest import load_manifest
    from harness.pipeline.inputs.captures import render_all
    from harness.pipeline.inputs.sources import Source
    from harness.pipeline.inputs.workspace import Workspace

    source = Source.select(
        load_manifest(manifest),
        Workspace.default(workspace),
        dataset,
        split_names(subjects),
        recipe,
    )
    with Bars(quiet=as_json) as bars:
        outcomes = render_all(source, jobs, bars, limit_s(timeout))
    tell(outcomes, as_json=as_json)
