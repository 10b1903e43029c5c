"""``harness check``: have the numbers moved?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Json, Run, WorkspacePath, split_names
from harness.cli.output import print_json
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError
from harness.core.records import Record
from harness.pipeline.inputs.workspace import Workspace
from harness.pipeline.run.store import RunStore
from reports.regression.baseline import Baseline
from reports.regression.baseline import update as new_baseline
from reports.regression.compare import compare, to_markdown, to_text
from reports.regression.spread import with_spread

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
            help="The run must have every method and subject of the baseline; otherwise those that "
            "it has are compared, and the others are named.",
        ),
    ] = False,
    update: Annotated[
        bool,
        typer.Option("--update", help="Write the run's numbers to BASELINE instead of comparing."),
    ] = False,
    spread: Annotated[
        str,
        typer.Option(
            "--spread",
            metavar="RUNS",
            help="With --update: other runs of the same methods and subjects, comma-separated; "
            "twice the largest difference between the runs becomes the tolerance where it is wider "
            "than the stored one.",
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
        previous = Baseline.load(baseline) if baseline.is_file() else None
        made = new_baseline(records, previous)
        others = {name: RunStore.existing(place, name).records() for name in split_names(spread)}
        (with_spread(made, others) if others else made).save(baseline)
        _show_written(records, baseline, as_json=as_json)
        return
    comparison = compare(records, Baseline.load(baseline), every=every)
    if summary is not None:
        with summary.open("a", encoding="utf-8") as stream:
            stream.write(to_markdown(comparison))
    if as_json:
        print_json({"passed": comparison.passed, **asdict(comparison)})
    else:
        print(to_text(comparison), end="")
    if not comparison.passed:
        raise typer.Exit(1)


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
