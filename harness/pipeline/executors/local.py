"""Tasks in threads of this process."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from harness.core.process.interrupts import in_threads
from harness.pipeline.executors.task import Answer, Task, groups, handler_of
from harness.pipeline.progress import Progress


@dataclass(frozen=True, slots=True)
class Local:
    """This machine; an ``Executor``.

    Attributes:
        jobs: Groups of tasks, such as all of a subject, at once.
    """

    jobs: int = 1

    def carry_out(
        self, tasks: Sequence[Task], progress: Progress, done: Callable[[Answer], None]
    ) -> None:
        """As ``Executor.carry_out``; what a handler raises ends everything."""
        host = platform.node()

        def one(group: Sequence[Task]) -> None:
            answers: dict[str, Mapping[str, Any]] = {}
            for task in group:
                begun = time.monotonic()
                handler = handler_of(task.handler)
                value = handler(task.job, answers.get(task.after), progress)
                answers[task.name] = value
                wall_s = time.monotonic() - begun
                done(Answer(task.name, dict(value), machine=host, wall_s=wall_s))

        in_threads(one, groups(tasks), self.jobs)
