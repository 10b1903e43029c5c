"""Progress with time left, on standard error so that standard output stays clean."""

from __future__ import annotations

import json
import sys
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

from harness.cli.progress_lines import ProgressLines

if TYPE_CHECKING:
    from harness.pipeline.inputs.captures import CaptureOutcome

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
    """Shows the pipeline's progress: bars on a terminal, lines elsewhere; a context manager.

    Args:
        quiet: Neither: only what is worth keeping is written.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet
        self._shown = _Drawn() if sys.stderr.isatty() else ProgressLines()

    def __enter__(self) -> Bars:
        self._shown.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._shown.__exit__(kind, error, trace)

    def expect(self, task: str, total: int) -> None:
        """Announce a task, unless there is nothing to do."""
        if total and not self._quiet:
            self._shown.expect(task, total)

    def done(self, task: str, steps: int = 1) -> None:
        """Count steps; work that nobody announced is not shown."""
        self._shown.done(task, steps)

    def say(self, text: str) -> None:
        """Print a line, above the bars where there are any."""
        self._shown.say(text)


class _Drawn:
    """Bars on a terminal."""

    def __init__(self) -> None:
        self._bars = Progress(
            TextColumn("{task.description:>16}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
        )
        self._tasks: dict[str, TaskID] = {}

    def __enter__(self) -> _Drawn:
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
        # Not before there is something to draw: errors come first, on a clean line.
        self._bars.start()
        self._tasks[task] = self._bars.add_task(task, total=total)

    def done(self, task: str, steps: int) -> None:
        if task in self._tasks:
            self._bars.advance(self._tasks[task], steps)

    def say(self, text: str) -> None:
        self._bars.console.print(text, markup=False, highlight=False)
