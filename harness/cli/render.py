"""``harness render``: photos of subjects, with the proof of their cameras."""

from __future__ import annotations

from harness.cli.display import print_outcomes, shown_progress
from harness.cli.options import (  # fmt: skip
    Cell,
    Dataset,
    ExecutorName,
    ExecutorOption,
    Jobs,
    Json,
    ManifestPath,
    RayAddress,
    Recipe,
    SlurmOptions,
    SplitName,
    Subjects,
    Timeout,
    Where,
    WorkspacePath,
    limit_s,
)  # fmt: skip
from harness.cli.verb_list import verb_group
from harness.data.manifest import load_manifest
from harness.run.captures import render_all
from harness.run.sources import chosen_source
from harness.run.workspace import Workspace

app = verb_group("render")


@app.command()
def render(
    dataset: Dataset = "avatars",
    subjects: Subjects = "",
    split: SplitName = "",
    recipe: Recipe = "paper8",
    jobs: Jobs = 1,
    timeout: Timeout = 3600.0,
    executor: ExecutorOption = ExecutorName.LOCAL,
    ray_address: RayAddress = "",
    slurm: SlurmOptions = None,
    cell: Cell = None,
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Render calibrated photos of subjects.

    Photos are RGBA files beside a file with their cameras; photos that are there and current are
    kept. The exit code is 1 when a subject failed.
    """
    checked, place = load_manifest(manifest), Workspace.default(workspace)
    source = chosen_source(checked, place, (dataset, split), subjects, recipe)
    where = Where(executor, cell, ray_address, slurm, timeout)
    elsewhere = where.executor(place, jobs)
    with shown_progress(quiet=as_json) as progress:
        outcomes = render_all(source, jobs, progress, limit_s(timeout), elsewhere)
    print_outcomes(outcomes, as_json=as_json)
