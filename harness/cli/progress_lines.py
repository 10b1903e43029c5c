"""Progress as plain lines, for logs: where there is no terminal to draw bars on."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

from harness.cli.progress_display import ProgressDisplay
from harness.core.plain_text import plain_text

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
