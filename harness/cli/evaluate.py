"""``harness eval``: reconstruct and score."""

from typing import Annotated

import typer

from harness.cli import options as opt
from harness.cli.display import print_json, shown_progress
from harness.cli.options import limit_s, parsed_settings, split_names
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError
from harness.core.files.names import CAMERAS
from harness.core.protocol_scores import ProtocolScore
from harness.core.settings import MetricProtocol
from harness.core.typed_json import to_json
from harness.data.manifest import load_manifest
from harness.report.seeds import evaluate_seeds, parsed_seeds, seed_requests
from harness.run.added_methods import AddedMethods
from harness.run.evaluate import EvalSummary
from harness.run.evaluate import evaluate as carry_out
from harness.run.method_choice import OPEN, ChosenMethod, chosen_methods, parsed_parts
from harness.run.plan import EvalRequest, plan
from harness.run.progress import Progress
from harness.run.protocol_scores import score_protocols
from harness.run.sealed import announce
from harness.run.sources import ScanSet, chosen_source
from harness.run.store import RunStore
from harness.run.uncalibrated import camera_suffix
from harness.run.workspace import Workspace

app = verb_group("eval")

NewRun = Annotated[
    str, typer.Option("--run", metavar="NAME", help="Folder below runs/ for the results.")
]
Keep = Annotated[
    bool,
    typer.Option(
        "--keep",
        help="Keep the intermediate results of methods: normal maps, partial surfaces, and a "
        "contact sheet of the stages.",
    ),
]
Row = Annotated[
    str,
    typer.Option(
        "--as",
        metavar="NAME",
        help="With --set and one method: the name of its row in tables, so that several settings "
        "of one method can be compared in one run.",
    ),
]
Cameras = Annotated[
    str,
    typer.Option(
        "--cameras",
        metavar="HOW",
        help=f"How cameras are known: {', '.join(CAMERAS)}. Refined ones are those given, as "
        "outlines and photos correct them. Estimated ones are found from the photos and their "
        "focal length (estimated-all: from the photos alone), and results are brought to the scan "
        "by their cameras. Rows are called such as mexecon+-uncalibrated.",
    ),
]
Seeds = Annotated[
    str,
    typer.Option(
        "--seeds",
        metavar="SEEDS",
        help="Several seeds, such as 0..4: the first in the run itself, the others in runs beside "
        "it. Methods that a seed cannot change run once. 'harness report --table seeds' shows the "
        "spread.",
    ),
]
Share = Annotated[
    bool,
    typer.Option(
        "--share/--no-share",
        help="Make body fits and landmarks once for all methods that need the same ones; their "
        "cost is counted for each.",
    ),
]


@app.command()
def evaluate(
    method: opt.MethodsToRun,
    dataset: opt.Dataset = "avatars",
    subjects: opt.Subjects = "",
    split: opt.SplitName = "",
    recipe: opt.Recipe = "paper8",
    protocol: opt.Protocol = "mexecon",
    run: NewRun = "main",
    settings: opt.Set = None,
    row: Row = "",
    cameras: Cameras = "given",
    parts: opt.Parts = OPEN,
    seed: opt.Seed = 0,
    seeds: Seeds = "",
    jobs: opt.Jobs = 1,
    keep: Keep = False,
    reason: opt.Reason = "",
    timeout: opt.Timeout = 3600.0,
    share: Share = True,
    executor: opt.ExecutorOption = opt.ExecutorName.LOCAL,
    ray_address: opt.RayAddress = "",
    slurm: opt.SlurmOptions = None,
    cell: opt.Cell = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only show what would run, and why.")
    ] = False,
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Run methods on subjects and score what they make.

    Missing photos are made first. Results that are current are kept, so the same command continues
    a stopped run. A result is current until something changes that its numbers depend on: photos,
    scan, true body and labels, code that is really used, the packages that it imports, settings,
    protocol or seed; --dry-run says what. A good result is never replaced because of a failure that
    is not the method's. Ctrl-C leaves nothing half done (exit code 130); 1 means: a subject failed.
    """
    checked, place = load_manifest(manifest), Workspace.default(workspace)
    rules, suffix = checked.protocols_of(protocol), camera_suffix(cameras)
    request = EvalRequest(
        source=chosen_source(checked, place, (dataset, split), subjects, recipe + suffix),
        methods=_methods(place, method, settings, row, parts, suffix),
        protocol=rules[0],
        store=RunStore(place.run(run)),
        seed=seed,
        jobs=jobs,
        keep=keep,
        reason=reason,
        timeout_s=limit_s(timeout),
        share=share,
        executor=opt.Where(executor, cell, ray_address, slurm, timeout).executor(place, jobs),
    )
    if dry_run:
        _show_plan(request, seeds, as_json=as_json)
    elif seeds:
        _run_seeds(request, seeds, rules[1:], as_json=as_json)
    else:
        _run(request, rules[1:], as_json=as_json)


def _methods(
    place: Workspace, named: str, settings: list[str] | None, row: str, parts: str, suffix: str
) -> tuple[ChosenMethod, ...]:
    names, given = split_names(named), parsed_settings(settings)
    return chosen_methods(names, given, row, parsed_parts(parts), AddedMethods.of(place), suffix)


def _show_plan(request: EvalRequest, seeds: str, *, as_json: bool) -> None:
    requests = seed_requests(request, parsed_seeds(seeds)) if seeds else (request,)
    announce(request.source.manifest, request.source.name, shown_progress())
    # Without its folder nothing would run.
    request.source.root()
    plans = [plan(each) for each in requests]
    if as_json:
        cells = [
            {**cell.to_dict(), **({"seed": each.seed} if len(requests) > 1 else {})}
            for each, found in zip(requests, plans, strict=True)
            for cell in found
        ]
        print_json(cells)
        return
    for each, found in zip(requests, plans, strict=True):
        of_seed = f"seed {each.seed:<5} " if len(requests) > 1 else ""
        for cell in found:
            print(f"{of_seed}{cell.method.row:18} {cell.subject:10} {cell.state:7} {cell.why}")
    for chosen in request.methods:
        used = "; ".join(f"{part.role} {part.name} ({part.licence})" for part in chosen.info.parts)
        print(f"{chosen.row:18} parts: {used or 'none'}")
    states = [cell.state for found in plans for cell in found]
    print(f"{states.count('run')} of {len(states)} cells would run")


def _run(request: EvalRequest, further: tuple[MetricProtocol, ...], *, as_json: bool) -> None:
    with shown_progress(quiet=as_json) as progress:
        summary = carry_out(request, progress)
        scores = _under_others(request, further, progress) if further else {}
    if as_json:
        others = {"protocols": to_json(scores)} if further else {}
        print_json({"run": str(request.store.directory), **summary.to_dict(), **others})
    else:
        counts = ", ".join(f"{number} {status}" for status, number in summary.counts.items())
        print(f"{counts} ({summary.cached} cached) in {request.store.directory}")
        _show_machines(request, summary)
        table = "photos" if request.source.is_imported else "geometry"
        table = "protocols" if further else table
        print(f"Next: harness report --table {table} --run {request.store.directory.name}")
    if not summary.all_ok:
        raise typer.Exit(1)


def _under_others(
    request: EvalRequest, protocols: tuple[MetricProtocol, ...], progress: Progress
) -> dict[str, list[ProtocolScore]]:
    """The run's meshes under further protocols."""
    source = request.source
    truth = ScanSet.select(source.manifest, source.workspace, source.name, source.subjects)
    rows = [method.row for method in request.methods]
    return score_protocols(request.store, truth, protocols, rows, progress)


def _show_machines(request: EvalRequest, summary: EvalSummary) -> None:
    """Which machine did what, where there may be several."""
    for machine in summary.machines if request.executor else ():
        print(f"  {machine}")


def _run_seeds(
    request: EvalRequest, seeds: str, further: tuple[MetricProtocol, ...], *, as_json: bool
) -> None:
    if further:
        raise HarnessError("--seeds is of one protocol", got=", ".join(p.name for p in further))
    with shown_progress(quiet=as_json) as progress:
        done = evaluate_seeds(request, parsed_seeds(seeds), progress)
    found = [(each, each.summary) for each in done if each.summary is not None]
    if as_json:
        print_json(
            {
                "runs": [
                    {"seed": each.seed, "run": str(each.store.directory), **summary.to_dict()}
                    for each, summary in found
                ]
            }
        )
    else:
        for each, summary in found:
            counts = ", ".join(f"{number} {status}" for status, number in summary.counts.items())
            print(f"seed {each.seed}: {counts} ({summary.cached} cached) in {each.store.directory}")
            _show_machines(request, summary)
        print(f"Next: harness report --table seeds --run {request.store.directory.name}")
    if not all(summary.all_ok for _, summary in found):
        raise typer.Exit(1)
