"""Runs on a machine of a cluster: one task there, with all that its answer should say."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from harness.core.errors import HarnessError
from harness.pipeline.executors.grants import granted
from harness.pipeline.executors.task import Answer, Task, handler_of
from harness.pipeline.progress import Silent

_OURS = "HARNESS_"


def travelling(task: Task, cpus: int) -> dict[str, object]:
    """A task as plain JSON values, with our own environment variables.

    The order in which this machine's user set paths to parts and devices holds there, too.
    """
    ours = {name: value for name, value in os.environ.items() if name.startswith(_OURS)}
    return {
        "name": task.name,
        "handler": task.handler,
        "values": task.values,
        "environment": ours,
        "cpus": cpus,
    }


def carry_out_here(
    task: Mapping[str, Any], before: Mapping[str, Any] | None = None, machine: str = ""
) -> dict[str, object]:
    """The answer of a task as plain JSON values.

    Args:
        task: As ``travelling`` gives it.
        before: Value of the answer of the task before it, if that is at hand.
        machine: What this machine is called; its host name by default.
    """
    for name in [name for name in os.environ if name.startswith(_OURS)]:
        del os.environ[name]
    os.environ.update(task["environment"])
    begun, heard = time.monotonic(), _Heard()
    value: Mapping[str, object] = {}
    lost = ""
    try:
        with granted(task["cpus"]):
            value = handler_of(task["handler"])(task["values"], before, heard)
    except HarnessError as error:
        # The request cannot be carried out on this machine, and would not on a second try.
        lost = str(error)
    return Answer(
        task=task["name"],
        value=dict(value),
        lost=lost,
        said=tuple(heard.lines),
        machine=machine or platform.node(),
        wall_s=time.monotonic() - begun,
    ).to_dict()


@dataclass(slots=True)
class _Heard(Silent):
    """Keeps the lines that are worth keeping."""

    lines: list[str] = field(default_factory=list[str])

    def say(self, text: str) -> None:
        """Keep a line."""
        self.lines.append(text)
