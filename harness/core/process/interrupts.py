"""Ctrl-C, SIGTERM and SIGHUP: a run stops at once, leaves nothing half done, says how to continue.

The main thread gets an ``Interrupted``. Threads that wait for workers or locks call
``require_not_stopped`` and get one, too. ``Interrupted`` is not an ``Exception``, so that no code
records it as a failure.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from types import FrameType
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_SHELL_BASE = 128
#: How long an import or a finaliser is left alone before the exception is raised after all.
_AGAIN_S = 0.01
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
        """What a shell expects: 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP."""
        return _SHELL_BASE + self.signal.value


_received: signal.Signals | None = None


def stopping_signal() -> signal.Signals | None:
    """The signal that the last ``stopped_by_signals`` got, or None."""
    return _received


def require_not_stopped() -> None:
    """Do nothing unless the run was asked to stop.

    Raises:
        Interrupted: a signal came, or the main thread left ``in_threads``.
    """
    if _stop.is_set():
        raise Interrupted(_received or signal.SIGINT)


@contextlib.contextmanager
def stopped_by_signals() -> Generator[None]:
    """Signals raise ``Interrupted`` in the main thread; a second one does what it did before.

    SIGHUP stays ignored where it is, as under ``nohup``.
    """
    global _received  # noqa: PLW0603
    _received = None
    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
        numbers.remove(signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in numbers}

    def stop(number: int, frame: FrameType | None) -> None:
        global _received  # noqa: PLW0603
        _received = signal.Signals(number)
        # Threads must see it, too: an exception that is raised in a callback would be lost.
        _stop.set()
        for one, handler in before.items():
            signal.signal(one, handler)
        arrive(number, frame)

    def arrive(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        if _is_lost_in(frame):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
        else:
            raise Interrupted(_received or signal.SIGINT)

    def unraisable(lost: sys.UnraisableHookArgs) -> None:
        if isinstance(lost.exc_value, Interrupted):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
        else:
            hook(lost)

    hook, alarm = sys.unraisablehook, signal.signal(signal.SIGALRM, arrive)
    sys.unraisablehook = unraisable
    try:
        for number in numbers:
            signal.signal(number, stop)
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in {**before, signal.SIGALRM: alarm}.items():
            signal.signal(number, handler)
        sys.unraisablehook = hook
        _stop.clear()


def _is_lost_in(frame: FrameType | None) -> bool:
    """Whether an exception raised in a frame may go no further: in imports and in finalisers."""
    while frame is not None:
        code = frame.f_code
        if code.co_name == "__del__" or code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


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
