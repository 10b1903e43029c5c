"""``harness train``: the open networks, from generated data to a file that methods use."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Jobs, Json, ManifestPath, Subjects, WorkspacePath, split_names

__all__ = ["app"]

app = typer.Typer(help="Train the open networks.", no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def train() -> None:
    """Train the open networks."""


@app.command("normals")
def normals(
    subjects: Subjects = "t00001..t00020",
    views: Annotated[int, typer.Option(min=1, help="Photos of each subject.")] = 32,
    steps: Annotated[int, typer.Option(min=1, help="Of the optimiser.")] = 1500,
    batch: Annotated[int, typer.Option(min=1, help="Photos a step.")] = 8,
    rate: Annotated[float, typer.Option(min=0.0, help="Greatest learning rate.")] = 1.5e-3,
    held_out: Annotated[int, typer.Option(min=1, help="Last subjects, which only judge.")] = 2,
    seed: Annotated[int, typer.Option(help="Of samples, weights and order.")] = 0,
    judge_every: Annotated[int, typer.Option(min=1, help="Steps between checkpoints.")] = 100,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder. Default: WORKSPACE/training/normals."),
    ] = None,
    dataset: Annotated[str, typer.Option("--dataset", help="Never the test subjects.")] = (
        "avatars-train"
    ),
    jobs: Jobs = 1,
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """The normal estimator, on generated subjects; the same command goes on after a stop."""
    from harness.cli.display import Bars
    from harness.data.manifest import load_manifest
    from harness.pipeline.inputs.sources import Source
    from harness.pipeline.inputs.workspace import Workspace
    from harness.pipeline.training.normals import TrainingRequest, train_normals
    from harness.pipeline.training.samples import SampleSettings
    from methods.normals.training.loop import TrainingSettings

    checked = load_manifest(manifest)
    place = Workspace.default(workspace)
    recipe = next(iter(checked.recipes))
    request = TrainingRequest(
        source=Source.select(checked, place, dataset, split_names(subjects), recipe),
        samples=SampleSettings(views=views, seed=seed),
        training=TrainingSettings(
            steps=steps, batch=batch, rate=rate, judge_every=judge_every, seed=seed
        ),
        directory=output or place.root / "training" / "normals",
        held_out=held_out,
        jobs=jobs,
    )
    with Bars(quiet=as_json) as bars:
        result = train_normals(request, bars)
    if as_json:
        print(json.dumps(result.to_dict(), indent=2))
        return
    print(f"front {result.front_deg:.2f} deg (body {result.body_front_deg:.2f}), ", end="")
    print(f"back {result.back_deg:.2f} deg (body {result.body_back_deg:.2f}), held-out subjects")
    print(f"{result.network}\n{result.curve}")
