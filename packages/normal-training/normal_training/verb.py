"""``harness train``: the open networks, from generated data to a file that methods use."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.display import print_json, shown_progress
from harness.cli.options import Jobs, Json, ManifestPath, Subjects, WorkspacePath, split_names
from harness.core.errors import DataError, HarnessError
from harness.core.files.names import checked_name
from harness.data.manifest import Manifest, load_manifest
from harness.run.sealed import refuse
from harness.run.sources import Source
from harness.run.workspace import Workspace
from methods.normals.installed import OPEN_NETWORK, named
from normal_training.judging.judge import JudgeRequest, judged_networks, to_markdown
from normal_training.judging.photos import BODY
from normal_training.learning.settings import NetworkPart, TrainingSettings
from normal_training.sampling.samples import SampleSettings
from normal_training.train_normals import TrainingRequest, TrainingResult, train_normals

app = typer.Typer(
    help="Train the open networks.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)


@app.callback()
def train() -> None:
    """Train the open networks."""


Views = Annotated[int, typer.Option(metavar="N", min=1, help="Number of photos of each subject.")]
Steps = Annotated[int, typer.Option(metavar="N", min=1, help="Number of optimiser steps.")]
Batch = Annotated[int, typer.Option(metavar="N", min=1, help="Number of photos in each step.")]
Rate = Annotated[float, typer.Option(metavar="RATE", min=0.0, help="Highest learning rate.")]
HeldOut = Annotated[
    int,
    typer.Option(
        metavar="N",
        min=1,
        help="Number of subjects of each dataset, from the end of the list, that are not "
        "trained on and measure the error.",
    ),
]
Seed = Annotated[
    int,
    typer.Option(metavar="N", help="Random seed of the photos, the first weights and the order."),
]
JudgeEvery = Annotated[
    int,
    typer.Option(
        metavar="N",
        min=1,
        help="Number of steps between two checkpoints, at which the error is measured.",
    ),
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FOLDER",
        help="Folder for checkpoint, error curve and network. Default: training/normals in "
        "the workspace.",
    ),
]
TrainingSets = Annotated[
    str,
    typer.Option(
        "--dataset",
        metavar="NAMES",
        help="Datasets to train on, with commas between them; never one used for results.",
    ),
]
NetworkName = Annotated[
    str, typer.Option("--name", metavar="NAME", help="What the network and its file are called.")
]
Start = Annotated[
    str,
    typer.Option(
        "--from",
        metavar="NETWORK",
        help="Network, by name or .onnx file, whose weights training starts from. Default: "
        "random weights.",
    ),
]
Blended = Annotated[
    float,
    typer.Option(
        "--blend",
        metavar="SHARE",
        help="Share of the weights of --from in the finished network, from 0 to below 1. What "
        "lies between two ends of one training is often better than either.",
    ),
]

FoldGain = Annotated[
    float,
    typer.Option(
        "--fold-gain",
        metavar="FACTOR",
        min=0.0,
        help="How many times as strong folds in front become in the network's answer where it "
        "expects to be 15 degrees off or more, and less where it is surer. A network that is "
        "unsure of a fold answers with a flatter one; 1 leaves it so.",
    ),
]

Detail = Annotated[
    bool,
    typer.Option(
        "--detail",
        help="Train the second network: it sees the person one and a half times as large, and "
        "what the network of --from answers in place of the body. That one stays as it is.",
    ),
]

Both = Annotated[
    bool,
    typer.Option(
        "--both",
        help="Train both networks together, each from its weights in --from: the first one on "
        "whole people, the second one on windows of what that answers.",
    ),
]


@app.command("normals")
def normals(
    subjects: Subjects = "t00001..t00020",
    views: Views = 32,
    steps: Steps = 1500,
    batch: Batch = 8,
    rate: Rate = 3e-3,
    held_out: HeldOut = 2,
    seed: Seed = 0,
    judge_every: JudgeEvery = 100,
    output: Output = None,
    dataset: TrainingSets = "avatars-train",
    start: Start = "",
    blend: Blended = 0.0,
    fold_gain: FoldGain = 1.0,
    detail: Detail = False,
    both: Both = False,
    name: NetworkName = OPEN_NETWORK,
    jobs: Jobs = 1,
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Train the network that estimates normals, on generated subjects.

    The same command continues after a stop.
    """
    checked = load_manifest(manifest)
    place = Workspace.default(workspace)
    request = TrainingRequest(
        sources=_sources(checked, place, dataset, subjects),
        samples=SampleSettings(views=views, seed=seed),
        training=TrainingSettings(
            steps=steps, batch=batch, rate=rate, judge_every=judge_every, seed=seed
        ),
        directory=output or place.root / "training" / "normals",
        held_out=held_out,
        jobs=jobs,
        start=_network_file(start) if start else None,
        name=checked_name("network", name),
        command=f"harness train normals --dataset {dataset} --subjects {subjects} "
        f"--views {views} --steps {steps} --batch {batch} --rate {rate:g} --held-out {held_out} "
        f"--seed {seed} --name {name}"
        + (f" --from {Path(start).name}" if start else "")
        + (f" --blend {blend:g}" if blend else "")
        + (f" --fold-gain {fold_gain:g}" if fold_gain != 1.0 else "")
        + (" --detail" if detail else "")
        + (" --both" if both else ""),
        blend=blend,
        fold_gain=fold_gain,
        part=asked_part(detail=detail, both=both),
    )
    with shown_progress(quiet=as_json) as progress:
        result = train_normals(request, progress)
    if as_json:
        print_json(result.to_dict())
    else:
        _print_result(result)


def asked_part(*, detail: bool, both: bool) -> NetworkPart:
    """Which network two flags ask to train.

    Raises:
        HarnessError: both are given.
    """
    if detail and both:
        raise HarnessError(
            "--detail and --both exclude each other",
            expected="at most one of them",
            hint="--both trains the second network, too",
        )
    if both:
        return NetworkPart.BOTH
    return NetworkPart.SECOND if detail else NetworkPart.FIRST


def _print_result(result: TrainingResult) -> None:
    print(f"front {result.front_deg:.2f} deg (body {result.body_front_deg:.2f}), ", end="")
    print(f"back {result.back_deg:.2f} deg (body {result.body_back_deg:.2f}), held-out subjects")
    print(f"expected errors are {result.front_calibration_deg:.2f} deg off in front, ", end="")
    print(f"{result.back_calibration_deg:.2f} on the back")
    for path in (result.network, result.curve, result.calibration, result.provenance):
        print(path)


Networks = Annotated[
    str,
    typer.Option(
        "--network",
        metavar="NETWORKS",
        help="Networks to compare, by name or .onnx file, with commas between them.",
    ),
]


@app.command("judge")
def judge(
    networks: Networks = OPEN_NETWORK,
    dataset: Annotated[
        str, typer.Option("--dataset", metavar="NAME", help="Generated subjects to measure on.")
    ] = "avatars",
    subjects: Subjects = "",
    views: Views = 8,
    seed: Seed = 0,
    jobs: Jobs = 1,
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Measure networks of normals on generated subjects: angles, folds, and what prints do.

    Each photo is made twice, plain and with prints on the subject. Prints are no folds, so that a
    network should find as many in both.
    """
    checked = load_manifest(manifest)
    place, recipe = Workspace.default(workspace), next(iter(checked.recipes))
    source = Source.select(checked, place, dataset, split_names(subjects), recipe)
    refuse(checked, source.name, "judging networks")
    request = JudgeRequest(
        source,
        _network_files(networks.split(",")),
        SampleSettings(views=views, seed=seed),
        jobs,
    )
    with shown_progress(quiet=as_json) as progress:
        rows = judged_networks(request, progress)
    if as_json:
        print_json([row.to_dict() for row in rows])
        return
    print(to_markdown(rows), end="")


def _sources(
    manifest: Manifest, place: Workspace, datasets: str, subjects: str
) -> tuple[Source, ...]:
    """The subjects of each dataset; an id goes to the first one that has it."""
    recipe = next(iter(manifest.recipes))
    names, left = split_names(datasets), split_names(subjects)
    if len(names) == 1:
        return (Source.select(manifest, place, names[0], left, recipe),)
    sources = []
    for name in names:
        known = set(Source.select(manifest, place, name, (), recipe).subjects)
        own = tuple(subject for subject in left if subject in known)
        if not own:
            raise HarnessError(
                f"none of the subjects belongs to {name}", hint="Name some with --subjects"
            )
        left = tuple(subject for subject in left if subject not in known)
        sources.append(Source.select(manifest, place, name, own, recipe))
    if left:
        raise HarnessError(
            f"no dataset of {', '.join(names)} has the subject {left[0]}",
            hint="Name its dataset with --dataset",
        )
    return tuple(sources)


def _network_files(names: Sequence[str]) -> dict[str, Path]:
    """The files of some networks by what a table calls them."""
    found: dict[str, Path] = {}
    for name in names:
        path = _network_file(name)
        if path.stem in (*found, BODY):
            raise HarnessError(
                f"two rows would be called '{path.stem}'", hint="Rename one of the files"
            )
        found[path.stem] = path
    return found


def _network_file(name: str) -> Path:
    """A file as it was named, or the imported or shipped network of that name."""
    if name.endswith(".onnx"):
        path = Path(name)
        if not path.is_file():
            raise DataError(f"there is no network {path}")
        return path
    return named(name).path
