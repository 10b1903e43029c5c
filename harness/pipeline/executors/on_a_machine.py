"""Runs on a machine of a cluster: one task there, with all that its answer should say."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from harness.core.errors import HarnessError
from harness.core.formats.typed_json import to_json
from harness.core.process.workers import typed_job
from harness.pipeline.executors.grants import granted
from harness.pipeline.executors.task import Answer, Task, handler_of
from harness.pipeline.progress import Silent

_OURS = "HARNESS_"


@dataclass(frozen=True, slots=True)
class Errand:
    """A task as it travels.

    Attributes:
        task: Its name.
        handler: Its handler.
        job: Its job, as JSON values.
        environment: Our own variables: the order in which this machine's user set paths to parts
            and devices holds there, too.
        cpus: Cores that it may use.
    """

    task: str
    handler: str
    job: object
    environment: Mapping[str, str]
    cpus: int

    @classmethod
    def of(cls, task: Task, cpus: int) -> Errand:
        """The errand of a task."""
        ours = {name: value for name, value in os.environ.items() if name.startswith(_OURS)}
        return cls(task.name, task.handler, to_json(task.job), ours, cpus)


def carry_out_here(
    errand: Errand, before: Mapping[str, Any] | None = None, machine: str = ""
) -> Answer:
    """The answer of a task.

    Args:
        errand: The task.
        before: Value of the answer of the task before it, if that is at hand.
        machine: What this machine is called; its host name by default.
    """
    for name in [name for name in os.environ if name.startswith(_OURS)]:
        del os.environ[name]
    os.environ.update(errand.environment)
    begun, heard = time.monotonic(), _Heard()
    value: Mapping[str, object] = {}
    lost = ""
    try:
        handler = handler_of(errand.handler)
        with granted(errand.cpus):
            value = handler(typed_job(handler, errand.job), before, heard)
    except HarnessError as error:
        # The request cannot be carried out on this machine, and would not on a second try.
        lost = str(error)
    said, wall_s = tuple(heard.lines), time.monotonic() - begun
    return Answer(errand.task, value, lost, said, machine or platform.node(), wall_s)


@dataclass(slots=True)
class _Heard(Silent):
    """Keeps the lines that are worth keeping."""

    lines: list[str] = field(default_factory=list[str])

    def say(self, text: str) -> None:
        """Keep a line."""
        self.lines.append(text)
