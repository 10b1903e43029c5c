"""``harness score``: a pair of surfaces, or a folder of surfaces made elsewhere."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from harness.cli import options as opt
from harness.cli.display import print_json, shown_progress
from harness.cli.options import split_names
from harness.cli.verb_list import verb_group
from harness.core.arrays import Floats
from harness.core.errors import HarnessError
from harness.core.files.npz import write_npz
from harness.core.settings import MetricProtocol
from harness.core.typed_json import to_json
from harness.data.manifest import load_manifest
from harness.run.external_meshes import FolderRequest, PairScores, score_folder, score_views
from harness.run.external_meshes import score as score_meshes
from harness.run.protocol_scores import score_protocols
from harness.run.sealed import Look, admit
from harness.run.sources import ScanSet
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from metrics.score import Score

app = verb_group("score")

Predicted = Annotated[
    Path,
    typer.Argument(
        metavar="PRED",
        help="A mesh, or a PLY file of points or Gaussians; or a folder of such files named by "
        "subject, such as a01.ply.",
    ),
]
Truth = Annotated[
    Path | None,
    typer.Option("--gt", metavar="FILE", help="The true mesh or photo, if PRED is one."),
]
MethodName = Annotated[
    str,
    typer.Option("--name", metavar="NAME", help="Name of the method that made a folder of meshes."),
]
Title = Annotated[
    str,
    typer.Option(
        "--title", metavar="TEXT", help="Title of that method in tables. Default: its name."
    ),
]
NewRun = Annotated[
    str,
    typer.Option("--run", metavar="NAME", help="Folder below runs/ for the results of a folder."),
]
Points = Annotated[
    Path | None,
    typer.Option(
        "--points",
        metavar="FILE",
        help="Write the errors of a single mesh point by point to this .npz file.",
    ),
]


@app.command()
def score(
    predicted: Predicted,
    gt: Truth = None,
    dataset: opt.Dataset = "",
    name: MethodName = "",
    title: Title = "",
    subjects: opt.Subjects = "",
    protocol: opt.Protocol = "mexecon",
    run: NewRun = "main",
    points: Points = None,
    reason: opt.Reason = "",
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Score meshes that were made elsewhere.

    Give --gt for one mesh, or --dataset and --name for a folder of meshes. Meshes are in metres in
    the world frame (+Y up); nothing is scaled or repaired, or aligned but where a protocol says so.
    A PLY file without faces is a cloud, or Gaussians as 3DGS and 2DGS write them: the surface of
    either is made as that of a method's result.
    The exit code is 1 when a subject of the dataset has no mesh, or one that cannot be scored, and
    when one of several protocols cannot measure a pair.

    A rendered picture is scored against a photo, both PNG, by --protocol nvs-actorshq or
    nvs-black1024.
    """
    if gt is not None and not dataset:
        of_folders = {
            "--name": name, "--title": title, "--subjects": subjects, "--reason": reason,
            "--run": run != "main",
        }  # fmt: skip
        _check_pair(predicted, gt, points, of_folders)
        kept = points is not None
        if gt.suffix == ".png":
            views = score_views(predicted, gt, protocol)
            print_json(to_json(views)) if as_json else print(views)
        else:
            found = score_meshes(predicted, gt, protocol, keep_points=kept, manifest=manifest)
            _show_pair(found, points, as_json=as_json)
    elif dataset and gt is None:
        _check_folder(name, points)
        checked = load_manifest(manifest)
        rule, *further = checked.protocols_of(protocol)
        place = Workspace.default(workspace)
        truth = ScanSet.select(checked, place, dataset, split_names(subjects))
        look = Look("scores of meshes", truth.name, truth.subjects, reason, (name,))
        admit(checked, place, look, shown_progress())
        store = RunStore(place.run(run))
        request = FolderRequest(predicted, name, title or name, truth, rule, store)
        _score_folder(request, further, as_json=as_json)
    else:
        raise HarnessError(
            f"no truth was named to compare {predicted} with",
            expected="either --gt or --dataset",
            got="both" if gt is not None else "neither",
            hint="Give --gt TRUTH for one mesh, or --dataset NAME --name METHOD for a folder",
        )


def _show_pair(found: PairScores, points: Path | None, *, as_json: bool) -> None:
    if points is not None:
        _write_points(points, found.single)
    print_json(found.to_dict()) if as_json else print(found)
    if found.failed:
        raise typer.Exit(1)


def _check_folder(name: str, points: Path | None) -> None:
    if not name:
        raise HarnessError("a folder needs a name", hint="Give --name mymethod")
    if points is not None:
        raise HarnessError("--points is of a single mesh", got="a folder", hint="Give --gt")


def _check_pair(
    predicted: Path, truth: Path, points: Path | None, of_folders: Mapping[str, object]
) -> None:
    """Refuse what a pair of meshes cannot be, and options that it takes no notice of."""
    ignored = next((option for option, value in of_folders.items() if value), "")
    if ignored:
        raise HarnessError(
            f"{ignored} is of a folder of meshes, and --gt names one", hint=f"Leave {ignored} out"
        )
    for path in (predicted, truth):
        if path.is_dir():
            raise HarnessError(
                f"{path} is a folder",
                expected="a mesh, with --gt",
                hint="Score a folder with --dataset NAME --name METHOD",
            )
    if points is not None and points.suffix != ".npz":
        raise HarnessError(f"--points {points}", expected="a file that ends in .npz")


def _write_points(path: Path, outcome: Score) -> None:
    arrays: dict[str, Floats] = {}
    for side, errors in (
        ("predicted", outcome.predicted_points),
        ("truth", outcome.truth_points),
    ):
        if errors is not None:
            arrays[f"{side}_points"] = errors.points
            arrays[f"{side}_distances_mm"] = errors.distances_mm
            arrays[f"{side}_normal_errors_deg"] = errors.normal_errors_deg
    write_npz(path.with_suffix(".npz"), arrays)


def _score_folder(
    request: FolderRequest, further: Sequence[MetricProtocol], *, as_json: bool
) -> None:
    with shown_progress(quiet=as_json) as progress:
        outcomes = score_folder(request, progress)
        if further:
            rows = [request.name]
            score_protocols(request.store, request.truth, further, rows, progress)
    if as_json:
        print_json([outcome.record.to_dict() for outcome in outcomes])
    else:
        scored = sum(outcome.status == "ok" for outcome in outcomes)
        print(f"{scored} of {len(outcomes)} subjects scored in {request.store.directory}")
        table = "protocols" if further else "geometry"
        print(f"Next: harness report --table {table} --run {request.store.directory.name}")
    if any(outcome.status != "ok" for outcome in outcomes):
        raise typer.Exit(1)
