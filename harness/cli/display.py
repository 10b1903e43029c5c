"""Progress bars with time left, on standard error so that standard output stays clean."""

from __future__ import annotations

import json
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

if TYPE_CHECKING:
    from harness.pipeline.captures import CaptureOutcome

__all__ = ["Bars", "tell"]


def tell(outcomes: Sequence[CaptureOutcome], *, as_json: bool) -> None:
    """Print what became of each subject; exit with 1 if one of them failed."""
    if as_json:
        print(json.dumps([outcome.to_dict() for outcome in outcomes], indent=2))
    else:
        for outcome in outcomes:
            print(outcome)
    if any(outcome.failure for outcome in outcomes):
        raise typer.Exit(1)


class Bars:
    """Draws the pipeline's progress; a context manager."""

    def __init__(self, *, quiet: bool = False) -> None:
        self._bars = Progress(
            TextColumn("{task.description:>16}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            disable=quiet,
        )
        self._tasks: dict[str, TaskID] = {}

    def __enter__(self) -> Bars:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._tasks:
            self._bars.stop()

    def expect(self, task: str, total: int) -> None:
        """Show a bar, unless there is nothing to do."""
        if total:
            # Not before there is something to draw: errors come first, on a clean line.
            self._bars.start()
            self._tasks[task] = self._bars.add_task(task, total=total)

    def done(self, task: str, steps: int = 1) -> None:
        """Move a bar; work that nobody announced has none."""
        if task in self._tasks:
            self._bars.advance(self._tasks[task], steps)

    def say(self, text: str) -> None:
        """Print a line above the bars."""
        self._bars.console.print(text, markup=False, highlight=False)
