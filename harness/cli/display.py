"""Progress with time left, on standard error so that standard output stays clean."""

from __future__ import annotations

import sys

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

from harness.cli.progress_display import ProgressDisplay
from harness.cli.progress_lines import ProgressLines
from harness.core.plain_text import plain_text


def shown_progress(*, quiet: bool = False) -> ProgressDisplay:
    """Bars on a terminal, lines elsewhere.

    Args:
        quiet: Show no tasks at all; lines that are worth keeping are still written.
    """
    return _Bars(quiet=quiet) if sys.stderr.isatty() else ProgressLines(quiet=quiet)


class _Bars(ProgressDisplay):
    """Bars on a terminal."""

    def __init__(self, *, quiet: bool = False) -> None:
        super().__init__(quiet=quiet)
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

    def begin(self, task: str, total: int) -> None:
        # Not before there is something to draw: errors come first, on a clean line.
        self._bars.start()
        self._tasks[task] = self._bars.add_task(task, total=total)

    def done(self, task: str, steps: int = 1) -> None:
        if task in self._tasks:
            self._bars.advance(self._tasks[task], steps)

    def say(self, text: str) -> None:
        self._bars.console.print(plain_text(text), markup=False, highlight=False)

    def close(self) -> None:
        if self._tasks:
            self._bars.stop()
