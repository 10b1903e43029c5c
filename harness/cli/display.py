"""What commands print: text, JSON, progress with the time left."""

from __future__ import annotations

import json
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self, TextIO

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

from harness.core.errors import plain_text
from harness.core.files.atomic import write_text
from harness.core.typed_json import to_json

if TYPE_CHECKING:
    from harness.run.captures import CaptureOutcome


class ProgressDisplay(ABC):
    """Shows the pipeline's progress on standard error; a context manager.

    Tasks without steps are not shown, nor are steps of tasks that nobody announced.

    Args:
        quiet: Show no tasks at all; lines that are worth keeping are still written.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def expect(self, task: str, total: int) -> None:
        """Announce a task of ``total`` steps."""
        if total and not self._quiet:
            self.begin(task, total)

    @abstractmethod
    def begin(self, task: str, total: int) -> None:
        """Show a task that has steps."""

    @abstractmethod
    def done(self, task: str, steps: int = 1) -> None:
        """Count steps of a task."""

    @abstractmethod
    def say(self, text: str) -> None:
        """Write a line that is worth keeping."""

    @abstractmethod
    def close(self) -> None:
        """Stop showing anything."""


#: A task's lines are at least this far apart; the line about its last step always comes.
_LEAST_PAUSE_S = 2.0
#: A task has a line after this time even if no step ended.
_LONGEST_SILENCE_S = 30.0


@dataclass(slots=True)
class _Task:
    """One task that is shown.

    Attributes:
        total: Steps in all.
        started_s: When it began, on the display's clock.
        written_s: When its last line was written.
        done: Steps that are done.
    """

    total: int
    started_s: float
    written_s: float
    done: int = 0


class ProgressLines(ProgressDisplay):
    """Writes ``photos: 5 of 16, 0:42 so far, about 1:32 left``; a context manager.

    Lines come when a task begins, after its steps (at most one every two seconds), when it is
    complete, and every half minute in which no step ends.

    Args:
        stream: Receives the lines; standard error by default.
        clock: Gives the time in seconds.
        quiet: Show no tasks at all; lines that are worth keeping are still written.
    """

    def __init__(
        self,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
        *,
        quiet: bool = False,
    ) -> None:
        super().__init__(quiet=quiet)
        self._stream = stream
        self._clock = clock
        self._tasks: dict[str, _Task] = {}
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._watch: threading.Thread | None = None

    def begin(self, task: str, total: int) -> None:
        """Write that no step is done yet."""
        with self._lock:
            now = self._clock()
            self._tasks[task] = _Task(total, now, now)
            self._print(f"{task}: 0 of {total}")
            if self._watch is None:
                self._watch = threading.Thread(target=self._keep_writing, daemon=True)
                self._watch.start()

    def done(self, task: str, steps: int = 1) -> None:
        """Count steps of a task, and write about it unless it had a line just before."""
        with self._lock:
            if task not in self._tasks:
                return
            state = self._tasks[task]
            state.done += steps
            if state.done >= state.total or self._clock() - state.written_s >= _LEAST_PAUSE_S:
                self._write(task, state)

    def say(self, text: str) -> None:
        """Write a line."""
        with self._lock:
            self._print(plain_text(text))

    def close(self) -> None:
        """Write no more lines."""
        self._over.set()
        if self._watch is not None:
            self._watch.join()

    def write_about_silent_tasks(self) -> None:
        """Write a line about every unfinished task that had none for half a minute."""
        with self._lock:
            for task, state in self._tasks.items():
                silent_s = self._clock() - state.written_s
                if state.done < state.total and silent_s >= _LONGEST_SILENCE_S:
                    self._write(task, state)

    def _keep_writing(self) -> None:
        while not self._over.wait(1.0):
            self.write_about_silent_tasks()

    def _write(self, task: str, state: _Task) -> None:
        state.written_s = self._clock()
        taken_s = state.written_s - state.started_s
        text = f"{task}: {state.done} of {state.total}, {_minutes(taken_s)} so far"
        if 0 < state.done < state.total:
            left_s = taken_s / state.done * (state.total - state.done)
            text += f", about {_minutes(left_s)} left"
        self._print(text)

    def _print(self, text: str) -> None:
        # Standard error is looked up now: it may have been redirected since.
        print(text, file=self._stream or sys.stderr, flush=True)


def _minutes(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


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


def how_to_open(page: Path) -> str:
    """Where a page is, and how it is opened."""
    return (
        f"{page}\nOpen it in a browser: {page.as_uri()}\n"
        "It needs no network. To pass it on, copy the whole folder."
    )


def deliver(text: str, output: Path | None) -> None:
    """Print a text; or write it to a file, and print the file's name.

    Raises:
        DataError: a full disk or a missing right.
    """
    if output is None:
        print(text, end="" if text.endswith("\n") else "\n")
    else:
        write_text(output, text)
        print(output)


def print_json(document: object) -> None:
    """Print dataclasses or JSON values, indented; a number that JSON does not have is an error."""
    print(json.dumps(to_json(document), indent=2, allow_nan=False))


def print_outcomes(outcomes: Sequence[CaptureOutcome], *, as_json: bool) -> None:
    """Print how making each subject ended; exit with 1 if one of them failed."""
    if as_json:
        print_json(outcomes)
    else:
        for outcome in outcomes:
            print(outcome)
    if any(outcome.failure for outcome in outcomes):
        raise typer.Exit(1)
