"""``harness check``: have the numbers moved?"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Json, Run, WorkspacePath, split_names

__all__ = ["check"]


def check(
    baseline: Annotated[Path, typer.Argument(help="The stored numbers.")],
    run: Run = None,
    update: Annotated[
        bool, typer.Option("--update", help="Write the present numbers as the baseline.")
    ] = False,
    spread: Annotated[
        str,
        typer.Option(
            "--spread",
            help="With --update: other runs of the same cells, comma-separated; tolerances become "
            "twice their largest difference.",
        ),
    ] = "",
    summary: Annotated[
        Path | None,
        typer.Option(
            "--summary",
            help="Append the outcome to this Markdown file.",
            envvar="GITHUB_STEP_SUMMARY",
        ),
    ] = None,
    workspace: WorkspacePath = None,
    as_json: Json = False,
) -> None:
    """Compare a run with a baseline; exit 1 when a number moved or a method is unguarded."""
    from harness.pipeline.inputs.workspace import Workspace
    from harness.pipeline.run.store import RunStore
    from reports.regression.baseline import Baseline, with_spread
    from reports.regression.baseline import update as new_baseline
    from reports.regression.compare import compare, to_markdown, to_text

    place = Workspace.default(workspace)
    records = RunStore.existing(place, run).records()
    if update:
        previous = Baseline.load(baseline) if baseline.is_file() else None
        made = new_baseline(records, previous)
        others = {name: RunStore.existing(place, name).records() for name in split_names(spread)}
        (with_spread(made, others) if others else made).save(baseline)
        print(f"{len(records)} records written to {baseline}")
        return
    comparison = compare(records, Baseline.load(baseline))
    if summary is not None:
        with summary.open("a", encoding="utf-8") as stream:
            stream.write(to_markdown(comparison))
    if as_json:
        print(json.dumps({"passed": comparison.passed, **asdict(comparison)}, indent=2))
    else:
        print(to_text(comparison), end="")
    if not comparison.passed:
        raise typer.Exit(1)
