"""``harness render``: photos of subjects, with the proof of their cameras."""

from harness.cli import options as opt
from harness.cli.display import print_outcomes, shown_progress
from harness.cli.options import limit_s
from harness.cli.verb_list import verb_group
from harness.data.manifest import load_manifest
from harness.run.captures import render_all
from harness.run.sources import chosen_source
from harness.run.workspace import Workspace

app = verb_group("render")


@app.command()
def render(
    dataset: opt.Dataset = "avatars",
    subjects: opt.Subjects = "",
    split: opt.SplitName = "",
    recipe: opt.Recipe = "paper8",
    jobs: opt.Jobs = 1,
    timeout: opt.Timeout = 3600.0,
    executor: opt.ExecutorOption = opt.ExecutorName.LOCAL,
    ray_address: opt.RayAddress = "",
    slurm: opt.SlurmOptions = None,
    cell: opt.Cell = None,
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Render calibrated photos of subjects.

    Photos are RGBA files beside a file with their cameras; photos that are there and current are
    kept. The exit code is 1 when a subject failed.
    """
    checked, place = load_manifest(manifest), Workspace.default(workspace)
    source = chosen_source(checked, place, (dataset, split), subjects, recipe)
    where = opt.Where(executor, cell, ray_address, slurm, timeout)
    elsewhere = where.executor(place, jobs)
    with shown_progress(quiet=as_json) as progress:
        outcomes = render_all(source, jobs, progress, limit_s(timeout), elsewhere)
    print_outcomes(outcomes, as_json=as_json)
