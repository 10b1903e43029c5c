"""``harness quickstart``: from nothing to the tables."""

from typing import Annotated

import typer

from harness.cli.display import how_to_open, print_json, shown_progress
from harness.cli.options import Jobs, Json, ManifestPath, WorkspacePath
from harness.cli.verb_list import verb_group
from harness.data.manifest import load_manifest
from harness.report.quickstart import quickstart as carry_out
from harness.run.workspace import Workspace

app = verb_group("quickstart")


@app.command()
def quickstart(
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    jobs: Jobs = 2,
    every: Annotated[
        bool, typer.Option("--all", help="Run every method, not just four: some ten minutes.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Make two avatars, run four methods, and show the results.

    Each avatar is photographed from eight sides, and a page shows all results. It takes four to
    seven minutes on two cores, with a table after each method; the last one, mexecon+, is run on
    the first avatar alone. The same command continues after a stop.
    """
    with shown_progress(quiet=as_json) as progress:
        place = Workspace.default(workspace)
        result = carry_out(load_manifest(manifest), place, progress, jobs, every=every)
    if as_json:
        files = [str(path) for path in result.files]
        counts = dict(result.summary.counts)
        page = str(result.page) if result.page else None
        print_json({"counts": counts, "files": files, "page": page})
    else:
        for table in result.tables:
            print(f"\n{table}")
        for reason in result.unavailable:
            print(f"not available: {reason}")
        print("Written:")
        for path in result.files:
            print(f"  {path}")
        if result.page:
            print(f"\nAll of it as a page, with surfaces that turn:\n{how_to_open(result.page)}")
    if not result.summary.all_ok:
        raise typer.Exit(1)
