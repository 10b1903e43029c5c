"""``harness score``: a pair of meshes, or a folder of meshes made elsewhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import (
    Dataset,
    Json,
    ManifestPath,
    Protocol,
    Reason,
    Subjects,
    WorkspacePath,
    split_names,
)  # fmt: skip
from harness.core.errors import HarnessError

if TYPE_CHECKING:
    from harness.core.settings import MetricProtocol
    from harness.data.manifest import Manifest
    from metrics.score import Score

__all__ = ["score"]


def score(
    predicted: Annotated[
        Path, typer.Argument(metavar="PRED", help="A mesh, or a folder of <id>.ply|obj|glb.")
    ],
    gt: Annotated[
        Path | None, typer.Option("--gt", help="The true mesh, for a single PRED.")
    ] = None,
    dataset: Dataset = "",
    name: Annotated[str, typer.Option("--name", help="Under which method a folder is filed.")] = "",
    title: Annotated[str, typer.Option("--title", help="Its title in tables.")] = "",
    subjects: Subjects = "",
    protocol: Protocol = "mexecon",
    run: Annotated[str, typer.Option("--run", help="Run folder for a folder's records.")] = "main",
    points: Annotated[
        Path | None, typer.Option("--points", help="Write per-point errors of a pair to this .npz.")
    ] = None,
    reason: Reason = "",
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Score a mesh against the truth, or a folder of meshes against a dataset.

    Meshes are metres in the world frame (+Y up); nothing is aligned, scaled or repaired.
    """
    from harness.data.manifest import load_manifest

    checked = load_manifest(manifest)
    rule = checked.protocol(protocol)
    if gt is not None and not dataset:
        _pair(predicted, gt, rule, points, as_json=as_json)
    elif dataset and gt is None:
        if not name:
            raise HarnessError("a folder needs a name", hint="Give --name mymethod")
        _admit(checked, (dataset, split_names(subjects)), name, reason, workspace)
        _folder(
            checked,
            (predicted, name, title or name),
            (dataset, subjects, run),
            rule,
            workspace,
            as_json,
        )
    else:
        raise HarnessError(
            "score what against what?",
            hint="Give --gt TRUTH for one mesh, or --dataset NAME --name METHOD for a folder",
        )


def _admit(
    manifest: Manifest,
    target: tuple[str, tuple[str, ...]],
    method: str,
    reason: str,
    workspace: Path | None,
) -> None:
    """Scores of meshes on sealed subjects need a reason and are logged."""
    from harness.cli.display import Bars
    from harness.pipeline.inputs.sealed import Look, admit
    from harness.pipeline.inputs.workspace import Workspace

    dataset, _, subjects = manifest.select(*target)
    look = Look("scores of meshes", dataset, subjects, reason, (method,))
    admit(manifest, Workspace.default(workspace), look, Bars())


def _pair(
    predicted: Path, truth: Path, rule: MetricProtocol, points: Path | None, *, as_json: bool
) -> None:
    from harness.pipeline.run.elsewhere import score_pair

    outcome = score_pair(predicted, truth, rule, keep_points=points is not None)
    if points is not None:
        _write_points(points, outcome)
    if as_json:
        document = {**outcome.to_dict(), "predicted": str(predicted), "truth": str(truth)}
        print(json.dumps(document, indent=2, allow_nan=False))
        return
    from harness.core.metric_catalog import METRICS

    print(f"{predicted} against {truth}, protocol {rule.name} v{rule.version}")
    for key, value in outcome.metrics.items():
        floor = f"   floor {value.floor:.3f} {value.unit}" if value.floor else ""
        print(
            f"  {METRICS[key].title:18} {value.value:9.3f} {value.unit:3} "
            f"± {value.standard_error:.3f} (standard error, n = {value.n}){floor}"
        )
    for warning in outcome.warnings:
        print(f"  warning: {warning}")


def _write_points(path: Path, outcome: Score) -> None:
    import numpy as np

    from harness.core.files.atomic import atomic_path

    arrays = {}
    for side, errors in (
        ("predicted", outcome.predicted_points),
        ("truth", outcome.truth_points),
    ):
        if errors is not None:
            arrays[f"{side}_points"] = errors.points
            arrays[f"{side}_distances_mm"] = errors.distances_mm
            arrays[f"{side}_normal_errors_deg"] = errors.normal_errors_deg
    with atomic_path(path.with_suffix(".npz")) as temporary:
        np.savez_compressed(temporary, **arrays)


def _folder(
    manifest: Manifest,
    what: tuple[Path, str, str],
    target: tuple[str, str, str],
    rule: MetricProtocol,
    workspace: Path | None,
    as_json: bool,
) -> None:
    from harness.cli.display import Bars
    from harness.pipeline.inputs.scan_set import ScanSet
    from harness.pipeline.inputs.workspace import Workspace
    from harness.pipeline.run.elsewhere import FolderRequest, score_folder
    from harness.pipeline.run.store import RunStore

    folder, name, title = what
    dataset, subjects, run = target
    place = Workspace.default(workspace)
    request = FolderRequest(
        folder=folder,
        name=name,
        title=title,
        truth=ScanSet.select(manifest, place, dataset, split_names(subjects)),
        protocol=rule,
        store=RunStore(place.run(run)),
    )
    with Bars(quiet=as_json) as bars:
        outcomes = score_folder(request, bars)
    if as_json:
        print(json.dumps([outcome.record.to_dict() for outcome in outcomes], indent=2))
    else:
        scored = sum(outcome.status == "ok" for outcome in outcomes)
        print(f"{scored} of {len(outcomes)} subjects scored in {request.store.directory}")
        print(f"Next: harness report --table geometry --run {run}")
    if any(outcome.status != "ok" for outcome in outcomes):
        raise typer.Exit(1)
