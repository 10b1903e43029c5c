"""A piece of work that can travel to another machine, and what comes back."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from harness.pipeline.progress import Progress

#: Does a task: from its job and the value of the answer before it to the value of its own answer.
Handler = Callable[[Any, Mapping[str, Any] | None, Progress], Mapping[str, object]]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """One piece of work, on whichever machine.

    It may be carried out more than once, because machines are lost. A handler therefore looks first
    whether its work is done.

    Attributes:
        name: Different from that of all other tasks.
        handler: ``package.module:function``.
        job: What the handler is given: a dataclass of plain values, or JSON values.
        group: Tasks of one group share what they read, such as the photos of a subject.
        after: Name of the task of the group that has to come first; it stands before this one.
            Empty for none.
        renders: Whether it renders photos, which needs no GPU.
    """

    name: str
    handler: str
    job: object
    group: str
    after: str = ""
    renders: bool = False


@dataclass(frozen=True, slots=True)
class Answer:
    """How a task ended.

    Attributes:
        task: Its name.
        value: The handler's answer; empty where ``lost`` says why there is none.
        lost: Why there is no answer although the task was tried as often as the executor tries.
        said: Lines for the person who started it all.
        machine: Where it was carried out.
        wall_s: How long it took there, seconds.
    """

    task: str
    value: Mapping[str, object] = field(default_factory=dict[str, object])
    lost: str = ""
    said: tuple[str, ...] = ()
    machine: str = ""
    wall_s: float = 0.0


class Executor(Protocol):
    """Carries tasks out somewhere."""

    def carry_out(
        self, tasks: Sequence[Task], progress: Progress, done: Callable[[Answer], None]
    ) -> None:
        """Carry all tasks out; ``done`` is called once for each, in any order.

        Args:
            tasks: Each stands behind the one that it waits for.
            progress: Shown what the executor itself has to say.
            done: Receives the answers; it may be called from several threads.

        Raises:
            MissingPart: a package or program that the executor needs is not installed.
            HarnessError: there is no such cluster, or it has no machine that is large enough.
            Interrupted: the run was stopped; so is what was under way.
        """
        ...


def handler_of(name: str) -> Handler:
    """The function behind ``package.module:function``."""
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)


def groups(tasks: Sequence[Task]) -> list[list[Task]]:
    """The tasks by group, in the order in which they came."""
    found: dict[str, list[Task]] = {}
    for task in tasks:
        found.setdefault(task.group, []).append(task)
    return list(found.values())
