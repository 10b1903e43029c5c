"""Ctrl-C and SIGTERM: a run stops at once, leaves nothing half done, and says how to continue.

The main thread gets an ``Interrupted``. Threads that wait for workers or locks call
``require_not_stopped`` and get one, too. ``Interrupted`` is not an ``Exception``, so that no code
records it as a failure.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from types import FrameType
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_SHELL_BASE = 128
_stop = threading.Event()


class Interrupted(BaseException):
    """A signal asked this process to end.

    Attributes:
        signal: Which one.
    """

    def __init__(self, number: int) -> None:
        self.signal = signal.Signals(number)
        super().__init__(self.signal.name)

    @property
    def exit_code(self) -> int:
        """What a shell expects: 130 after Ctrl-C, 143 after SIGTERM."""
        return _SHELL_BASE + self.signal.value


_received = signal.SIGINT


def require_not_stopped() -> None:
    """Do nothing unless the run was asked to stop.

    Raises:
        Interrupted: a signal came, or the main thread left ``in_threads``.
    """
    if _stop.is_set():
        raise Interrupted(_received)


@contextlib.contextmanager
def stopped_by_signals() -> Generator[None]:
    """SIGINT and SIGTERM raise ``Interrupted`` in the main thread; a second one ends at once."""

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        global _received  # noqa: PLW0603
        if _stop.is_set():
            # Workers notice that their parent is gone.
            os._exit(_SHELL_BASE + number)
        _received = signal.Signals(number)
        # Threads must see it, too: an exception that is raised in a callback would be lost.
        _stop.set()
        raise Interrupted(number)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _stop.clear()


def in_threads(work: Callable[[Item], Result], items: Iterable[Item], jobs: int) -> list[Result]:
    """``work`` of every item, in order, ``jobs`` at once.

    When the main thread is interrupted, no further item begins and waiting ones are stopped.
    """

    def one(item: Item) -> Result:
        require_not_stopped()
        return work(item)

    by_us = False
    try:
        with ThreadPoolExecutor(max_workers=max(1, jobs)) as pool:
            try:
                return list(pool.map(one, items))
            except KeyboardInterrupt:
                # Python's own exception, raised where ``stopped_by_signals`` is not active.
                by_us = not _stop.is_set()
                _stop.set()
                raise
    finally:
        if by_us:
            _stop.clear()
