"""Threads, memory and progress of one process."""

import ctypes
import gc
import os
import sys
from collections.abc import Callable, Iterable
from typing import TypeVar

from harness.core.process.interrupts import in_threads

Item = TypeVar("Item")
Result = TypeVar("Result")


def on_all_cores(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """The results of ``function`` for all items, in the items' order.

    Use it where one call takes milliseconds at least, and spends them in numpy, scipy, Open3D or
    compiled kernels: those let other threads run, plain Python does not. Items must not wait for
    each other.

    Args:
        function: Called in several threads at once; it must not change what they share.
        items: All of them.

    Raises:
        Exception: the first one that the function raised, in the items' order.
        Interrupted: the run was stopped.
    """
    return in_threads(function, items, len(os.sched_getaffinity(0)))


def give_freed_memory_back() -> None:
    """Let the system have what this process has freed but still holds.

    The GNU C library keeps freed memory for later requests of the same sizes; after a library has
    been closed these never come. Nothing happens with other C libraries.
    """
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


#: Called with (steps done, steps in all) after each step of one piece of work.
StepReport = Callable[[int, int], None]


def silent(_done: int, _total: int) -> None:
    """A step report that nobody shows."""
