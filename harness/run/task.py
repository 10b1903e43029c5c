"""A piece of work that can travel to another machine, what it may use there, what comes back."""

from __future__ import annotations

import contextlib
import fcntl
import importlib
import importlib.util
import os
import platform
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

from harness.core.errors import HarnessError
from harness.core.missing import not_installed
from harness.core.process.interrupts import in_threads
from harness.core.process.workers import typed_job
from harness.core.typed_json import to_json
from harness.run.progress import Progress, Silent

#: How many threads numeric libraries start; each reads its own.
_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


@dataclass(frozen=True, slots=True)
class Grant:
    """What one task may use.

    Attributes:
        cpus: Cores.
        gpus: GPUs of a cell, or a share of one; photos have none.
        memory_gib: Memory that has to be free where it runs, GiB; 0 asks for none.
    """

    cpus: int = 1
    gpus: float = 0.0
    memory_gib: float = 0.0

    def __post_init__(self) -> None:
        if self.cpus < 1 or self.gpus < 0 or self.memory_gib < 0:
            raise HarnessError(
                "a task needs one core at least, and no negative number of GPUs or GiB",
                got=f"{self.cpus} cores, {self.gpus:g} GPUs, {self.memory_gib:g} GiB",
            )


@contextlib.contextmanager
def granted(cpus: int) -> Generator[None]:
    """Let child processes that are started in the block use ``cpus`` cores and no more.

    Blender, Open3D and our own threads use every core that they see, so that these processes are
    bound to cores, which no other block on this machine has as long as there are enough.
    """
    allowed = os.sched_getaffinity(0)
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, str(cpus)))
    try:
        with contextlib.ExitStack() as held:
            own = _own_cores(cpus, sorted(allowed), held) if cpus < len(allowed) else allowed
            os.sched_setaffinity(0, own)
            yield
    finally:
        os.sched_setaffinity(0, allowed)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _own_cores(cpus: int, allowed: list[int], held: contextlib.ExitStack) -> set[int]:
    """Cores that no other block on this machine has, or any where fewer than ``cpus`` are free.

    The locks lie on this machine's own disk, and the kernel releases those of a process that dies.
    """
    folder = Path(tempfile.gettempdir(), f"harness-cores-{os.getuid()}")
    found: set[int] = set()
    with contextlib.suppress(OSError), contextlib.ExitStack() as candidates:
        folder.mkdir(mode=0o700, exist_ok=True)
        for core in allowed:
            stream = candidates.enter_context((folder / str(core)).open("a"))
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            found.add(core)
            if len(found) == cpus:
                held.push(candidates.pop_all())
                return found
    # More is granted on this machine than it has: several tasks share a core then.
    first = os.getpid() % len(allowed)
    return set((allowed[first:] + allowed[:first])[:cpus])


def extra_package(package: str, purpose: str) -> ModuleType:
    """A package of an extra, imported now: it takes a second, and most runs do without.

    Args:
        package: Its name.
        purpose: What needs it, as the beginning of a sentence.

    Raises:
        MissingPart: it is not installed.
    """
    if importlib.util.find_spec(package) is None:
        raise not_installed(package, purpose)
    return importlib.import_module(package)


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


_TIMEOUT_S = 30


@dataclass(frozen=True, slots=True)
class MachineFacts:
    """What a record says of the machine that it was made on.

    Attributes:
        host: Its name.
        gpus: Names of its GPUs.
        driver: Version of the GPUs' driver; empty where there are none.
    """

    host: str
    gpus: tuple[str, ...] = ()
    driver: str = ""

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, without what there is not."""
        found: dict[str, object] = {"host": self.host}
        if self.gpus:
            found |= {"gpus": list(self.gpus), "driver": self.driver}
        return found


@cache
def machine_facts() -> MachineFacts:
    """Those of this machine, looked up once a process."""
    smi = shutil.which("nvidia-smi")
    if smi is None:
        return MachineFacts(platform.node())
    command = [smi, "--query-gpu=name,driver_version", "--format=csv,noheader"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=True
        )
    except (OSError, subprocess.SubprocessError):
        # A driver that does not answer is no reason to lose a result.
        return MachineFacts(platform.node())
    rows = [line.split(", ") for line in done.stdout.splitlines() if ", " in line]
    driver = rows[0][-1] if rows else ""
    return MachineFacts(platform.node(), tuple(row[0] for row in rows), driver)


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
