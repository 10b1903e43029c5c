"""``harness check``: have the numbers moved?"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.display import print_json
from harness.cli.options import Json, Run, WorkspacePath, split_names
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError
from harness.core.records import Record
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from reports.regression.baseline import Baseline
from reports.regression.baseline import update as new_baseline
from reports.regression.compare import Comparison, compare, to_markdown, to_text, with_spread

app = verb_group("check")


@app.command()
def check(
    baseline: Annotated[
        Path, typer.Argument(metavar="BASELINE", help="File with the stored numbers.")
    ],
    run: Run = None,
    every: Annotated[
        bool,
        typer.Option(
            "--all",
            help="The run must have all that the baseline has; otherwise what it has is compared.",
        ),
    ] = False,
    update: Annotated[
        bool, typer.Option("--update", help="Store the run's numbers instead of comparing.")
    ] = False,
    spread: Annotated[
        str,
        typer.Option(
            "--spread",
            metavar="RUNS",
            help="With --update: runs of the same methods on the same photos in other arithmetic, "
            "comma-separated; three times the largest difference becomes the tolerance where that "
            "is wider than the stored one.",
        ),
    ] = "",
    summary: Annotated[
        Path | None,
        typer.Option(
            "--summary",
            metavar="FILE",
            help="Append the outcome to this Markdown file.",
            envvar="GITHUB_STEP_SUMMARY",
        ),
    ] = None,
    workspace: WorkspacePath = None,
    as_json: Json = False,
) -> None:
    """Compare the numbers of a run with a stored baseline.

    The exit code is 1 when a number moved by more than its tolerance or is missing, or when a
    method of the run has no stored numbers.
    """
    if every and update:
        raise HarnessError("--all is for comparing", got="--update, which stores what the run has")
    if spread and not update:
        raise HarnessError("--spread widens the tolerances that --update writes", got="no --update")
    place = Workspace.default(workspace)
    records = RunStore.existing(place, run).records()
    if update:
        others = {name: RunStore.existing(place, name).records() for name in split_names(spread)}
        _write(records, others, baseline)
        _show_written(records, baseline, as_json=as_json)
        return
    comparison = compare(records, Baseline.load(baseline), every=every)
    if summary is not None:
        _append(to_markdown(comparison), summary)
    _show(comparison, as_json=as_json)
    if not comparison.passed:
        raise typer.Exit(1)


def _write(
    records: Sequence[Record], others: Mapping[str, Sequence[Record]], baseline: Path
) -> None:
    made = new_baseline(records, Baseline.load(baseline) if baseline.is_file() else None)
    (with_spread(made, others) if others else made).save(baseline)


def _show(comparison: Comparison, *, as_json: bool) -> None:
    if as_json:
        print_json({"passed": comparison.passed, **asdict(comparison)})
    else:
        print(to_text(comparison), end="")


def _append(text: str, path: Path) -> None:
    with path.open("a", encoding="utf-8") as stream:
        stream.write(text)


def _show_written(records: Sequence[Record], baseline: Path, *, as_json: bool) -> None:
    """What was stored; records without numbers are named, since they guard nothing."""
    without = [record for record in records if record.status != "ok"]
    if as_json:
        cells = [{"method": each.method_name, "subject": each.subject} for each in without]
        print_json({"file": str(baseline), "records": len(records), "without_numbers": cells})
        return
    print(f"{len(records)} records written to {baseline}")
    for each in without:
        cell = f"{each.method_name} on {each.subject}"
        print(f"without numbers: {cell} {each.status}: {each.reason_line}")
