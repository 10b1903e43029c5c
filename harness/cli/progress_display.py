"""What the displays of the pipeline's progress have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self


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
