"""``harness quickstart``: from nothing to the tables."""

from __future__ import annotations

import json

import typer

from harness.cli.options import Jobs, Json, ManifestPath, WorkspacePath

__all__ = ["quickstart"]


def quickstart(
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """Two avatars, eight photos each, every method, the tables. Some minutes."""
    from harness.cli.display import Bars
    from harness.data.manifest import load_manifest
    from harness.pipeline.inputs.workspace import Workspace
    from harness.pipeline.quickstart import quickstart as carry_out

    with Bars(quiet=as_json) as bars:
        result = carry_out(load_manifest(manifest), Workspace.default(workspace), bars, jobs)
    if as_json:
        files = [str(path) for path in result.files]
        print(json.dumps({"counts": dict(result.summary.counts), "files": files}, indent=2))
    else:
        for table in result.tables:
            print(f"\n{table}")
        for reason in result.unavailable:
            print(f"not available: {reason}")
        print("Written:")
        for path in result.files:
            print(f"  {path}")
    if result.summary.counts.get("ok", 0) < len(result.summary.records):
        raise typer.Exit(1)
