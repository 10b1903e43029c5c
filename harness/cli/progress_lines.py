"""Progress as plain lines, for logs: where there is no terminal to draw bars on."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import TextIO

__all__ = ["ProgressLines"]

#: A task's steps are told no more often than this, its last one always.
_LEAST_PAUSE_S = 2.0
#: Work that takes longer is told of even where no step ends.
_LONGEST_SILENCE_S = 30.0


@dataclass(slots=True)
class _Task:
    total: int
    started_s: float
    told_s: float
    done: int = 0


class ProgressLines:
    """Writes ``photos: 5 of 16, 0:42 so far, about 1:32 left``; a context manager.

    Lines come when a task begins, after its steps (at most one every two seconds), when it is
    complete, and every half minute in which no step ends.

    Args:
        stream: Where to; standard error by default.
        clock: Seconds.
    """

    def __init__(
        self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._stream = stream
        self._clock = clock
        self._tasks: dict[str, _Task] = {}
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._watch: threading.Thread | None = None

    def __enter__(self) -> ProgressLines:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._over.set()
        if self._watch is not None:
            self._watch.join()

    def expect(self, task: str, total: int) -> None:
        """Tell that a task begins, unless there is nothing to do."""
        if not total:
            return
        with self._lock:
            now = self._clock()
            self._tasks[task] = _Task(total, now, now)
            self._print(f"{task}: 0 of {total}")
            if self._watch is None:
                self._watch = threading.Thread(target=self._keep_telling, daemon=True)
                self._watch.start()

    def done(self, task: str, steps: int = 1) -> None:
        """Count steps and tell of them; work that nobody announced is not told."""
        with self._lock:
            if task not in self._tasks:
                return
            state = self._tasks[task]
            state.done += steps
            if state.done >= state.total or self._clock() - state.told_s >= _LEAST_PAUSE_S:
                self._tell(task, state)

    def say(self, text: str) -> None:
        """Write a line."""
        with self._lock:
            self._print(text)

    def tell_the_silent(self) -> None:
        """Write a line about every task that has not been told of for half a minute."""
        with self._lock:
            for task, state in self._tasks.items():
                silent_s = self._clock() - state.told_s
                if state.done < state.total and silent_s >= _LONGEST_SILENCE_S:
                    self._tell(task, state)

    def _keep_telling(self) -> None:
        while not self._over.wait(1.0):
            self.tell_the_silent()

    def _tell(self, task: str, state: _Task) -> None:
        state.told_s = self._clock()
        taken_s = state.told_s - state.started_s
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
