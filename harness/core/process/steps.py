"""How long work counts its steps for whoever shows them."""

from __future__ import annotations

from collections.abc import Callable

#: Called with (steps done, steps in all) after each step of one piece of work.
StepReport = Callable[[int, int], None]


def silent(_done: int, _total: int) -> None:
    """A step report that nobody shows."""
