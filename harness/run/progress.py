"""How the pipeline reports what it is doing; the command line shows it."""

from __future__ import annotations

from typing import Protocol

from harness.core.process.threads import StepReport


class Progress(Protocol):
    """Receives the pipeline's progress, possibly from several threads."""

    def expect(self, task: str, total: int) -> None:
        """A task of ``total`` steps begins."""
        ...

    def done(self, task: str, steps: int = 1) -> None:
        """Some of its steps are done."""
        ...

    def say(self, text: str) -> None:
        """One line worth keeping on the screen."""
        ...


class Silent:
    """Shows nothing."""

    def expect(self, task: str, total: int) -> None:
        """Ignore."""

    def done(self, task: str, steps: int = 1) -> None:
        """Ignore."""

    def say(self, text: str) -> None:
        """Ignore."""


def counted(progress: Progress, task: str) -> StepReport:
    """The step report for a worker, which counts the worker's steps as steps of a task."""
    before = 0

    def steps(done: int, total: int) -> None:  # noqa: ARG001
        nonlocal before
        progress.done(task, done - before)
        before = done

    return steps
