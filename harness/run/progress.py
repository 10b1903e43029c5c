"""How the pipeline reports what it is doing; the command line shows it."""

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


#: Names of the tasks that count photos, and what is done to find their cameras.
PHOTOS, CAMERAS = "photos", "steps towards cameras"


class PhotoSteps:
    """The step report for a worker: first a step for each photo, then those towards cameras.

    Args:
        progress: Has been told of both tasks.
        photos: How many photos the worker makes.
        cameras: How many steps towards cameras may follow.
    """

    def __init__(self, progress: Progress, photos: int, cameras: int = 0) -> None:
        self._progress, self._photos, self._total = progress, photos, photos + cameras
        self._before = 0

    def __call__(self, done: int, total: int) -> None:  # noqa: ARG002
        """Count what was done since."""
        before, self._before = self._before, min(done, self._total)
        photos = min(self._before, self._photos) - min(before, self._photos)
        for task, steps in ((PHOTOS, photos), (CAMERAS, self._before - before - photos)):
            if steps:
                self._progress.done(task, steps)

    def end(self) -> None:
        """Steps that were not needed are done, too."""
        self(self._total, self._total)


def counted(progress: Progress, task: str) -> StepReport:
    """The step report for a worker, which counts the worker's steps as steps of a task."""
    before = 0

    def steps(done: int, total: int) -> None:  # noqa: ARG001
        nonlocal before
        progress.done(task, done - before)
        before = done

    return steps
