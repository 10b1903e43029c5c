"""One function for many items on all cores of this process, in threads."""

from __future__ import annotations

import os
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
