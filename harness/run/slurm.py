"""Tasks as Slurm array jobs, through submitit.

Each element of an array carries out a chunk of tasks and files each answer in a folder that all
machines see; the folder tells what is done. Elements that end without all their answers, because
their machine was lost or their time was up, are submitted again with what is left.
"""

import math
import os
import shutil
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from harness.core.errors import DataError, HarnessError, MissingPart
from harness.core.files.atomic import read_json, write_json
from harness.core.process.interrupts import require_not_stopped
from harness.core.typed_json import from_json, to_json
from harness.run.progress import Progress
from harness.run.task import Answer, Errand, Grant, Task, carry_out_here, extra_package

#: Below the 1001 that Slurm's MaxArraySize is unless somebody changed it.
_MOST_ELEMENTS = 1000
#: How often tasks without an answer are submitted.
_ROUNDS = 3
_POLL_S = 1.0
#: How long a finished element's answers may take to be seen here, through a network's caches.
_VISIBLE_S = 90.0


@dataclass(frozen=True, slots=True)
class Slurm:
    """A Slurm cluster; an ``Executor``.

    Attributes:
        folder: Receives jobs, their answers and their logs; all machines see it under this name.
        grant: What each task may use.
        timeout_s: Longest time for one task; None takes the partition's.
        options: Passed on to submitit, such as ``partition``.
        cluster: ``local`` runs the same jobs as processes of this machine, to try things out.
    """

    folder: Path
    grant: Grant = field(default_factory=Grant)
    timeout_s: float | None = None
    options: Mapping[str, str] = field(default_factory=dict[str, str])
    cluster: Literal["slurm", "local"] = "slurm"

    def require_usable(self) -> None:
        """Nothing, if submitit and Slurm are there.

        Raises:
            MissingPart: one of them is not.
        """
        extra_package("submitit", "--executor slurm")
        if self.cluster == "slurm" and shutil.which("sbatch") is None:
            raise MissingPart(
                "--executor slurm needs Slurm's command 'sbatch', which is not on this machine",
                hint="Run it on a login node; --slurm cluster=local tries the same on this machine",
            )

    def carry_out(
        self, tasks: Sequence[Task], progress: Progress, done: Callable[[Answer], None]
    ) -> None:
        """As ``Executor.carry_out``."""
        self.require_usable()
        submitit = extra_package("submitit", "--executor slurm")
        folder = self.folder.resolve() / uuid.uuid4().hex[:12]
        try:
            left = {task.name: task for task in tasks}
            for number in range(_ROUNDS):
                if left:
                    submitted = _Round(self, submitit, folder / str(number), list(left.values()))
                    submitted.carry_out(left, done)
                    if left and number + 1 < _ROUNDS:
                        progress.say(f"{len(left)} tasks have no answer and are submitted again")
            for name in left:
                done(Answer(name, lost=f"its job ended {_ROUNDS} times without an answer"))
        finally:
            shutil.rmtree(folder, ignore_errors=True)


class _Round:
    """Tasks that are submitted together.

    Args:
        slurm: How.
        submitit: The package.
        folder: Of this round.
        tasks: All of them.
    """

    def __init__(self, slurm: Slurm, submitit: Any, folder: Path, tasks: Sequence[Task]) -> None:
        self._slurm, self._submitit, self._folder, self._tasks = slurm, submitit, folder, tasks
        self._jobs: list[Any] = []

    def carry_out(self, left: dict[str, Task], done: Callable[[Answer], None]) -> None:
        """Submit, and take answers until all are there or all jobs have ended."""
        photos = [task for task in self._tasks if task.renders]
        cells = [task for task in self._tasks if not task.renders]
        try:
            before = self._submit("photos", photos, 0.0, [])
            if self._slurm.cluster == "local":
                # Nothing makes these processes wait for each other, so that we do.
                self._follow(left, done, waits_for={task.name for task in photos})
            self._submit("cells", cells, self._slurm.grant.gpus, before)
            self._follow(left, done, waits_for={task.name for task in self._tasks})
        finally:
            for job in self._jobs:
                if not job.done():
                    job.cancel(check=False)

    def _submit(
        self, kind: str, tasks: Sequence[Task], gpus: float, after: Sequence[str]
    ) -> list[str]:
        """Submit tasks as an array; the ids of its jobs."""
        if not tasks:
            return []
        most = _MOST_ELEMENTS
        if self._slurm.cluster == "local":
            most = max(1, len(os.sched_getaffinity(0)) // self._slurm.grant.cpus)
        size = math.ceil(len(tasks) / most)
        elements: list[str] = []
        for first in range(0, len(tasks), size):
            path = self._folder / f"{kind}-{first // size}.json"
            chunk = [
                Errand.of(task, self._slurm.grant.cpus) for task in tasks[first : first + size]
            ]
            write_json(path, to_json(Element(tuple(chunk), self._answers)))
            elements.append(str(path))
        executor = self._executor(kind, gpus, size, after)
        try:
            jobs = executor.map_array(carry_out_element, elements)
        except (RuntimeError, OSError, ValueError) as error:
            # submitit raises these, and its own errors are kinds of them.
            raise HarnessError(
                "Slurm did not take the jobs",
                got=str(error).strip().splitlines()[-1][:300],
                hint="Give what this cluster wants with --slurm, such as --slurm partition=NAME",
            ) from error
        self._jobs += jobs
        return sorted({str(job.job_id).partition("_")[0] for job in jobs})

    def _executor(self, kind: str, gpus: float, size: int, after: Sequence[str]) -> Any:
        slurm = self._slurm
        executor = self._submitit.AutoExecutor(folder=self._folder / "logs", cluster=slurm.cluster)
        settings: dict[str, object] = {"name": f"harness-{kind}"}
        if slurm.timeout_s is not None:
            settings["timeout_min"] = math.ceil(size * slurm.timeout_s / 60) + 5
        if slurm.cluster == "slurm":
            settings |= {"cpus_per_task": slurm.grant.cpus}
            if slurm.grant.memory_gib:
                settings["mem_gb"] = slurm.grant.memory_gib
            if gpus:
                settings["slurm_gres"] = f"gpu:{math.ceil(gpus)}"
            settings |= {f"slurm_{name}": _plain(text) for name, text in slurm.options.items()}
            if after:
                # Not afterok: a subject whose photos failed has records that say so.
                settings["slurm_dependency"] = "afterany:" + ":".join(after)
        executor.update_parameters(**settings)
        return executor

    @property
    def _answers(self) -> Path:
        return self._folder / "answers"

    def _follow(
        self, left: dict[str, Task], done: Callable[[Answer], None], waits_for: set[str]
    ) -> None:
        """Take answers until there is none left to wait for, or all jobs have ended."""
        ended_s: float | None = None
        while waits_for & left.keys():
            require_not_stopped()
            found = self._take(left, done)
            if not found and all(job.done() for job in self._jobs):
                now = time.monotonic()
                ended_s = now if ended_s is None else ended_s
                wait_s = _VISIBLE_S if self._slurm.cluster == "slurm" else _POLL_S
                if now - ended_s >= wait_s:
                    return
            time.sleep(_POLL_S)

    def _take(self, left: dict[str, Task], done: Callable[[Answer], None]) -> int:
        """Take the answers that are there; how many."""
        found = 0
        for path in sorted(self._answers.glob("*.json")):
            if path.name.startswith("."):
                # Still being written, and not ours to delete.
                continue
            try:
                answer = from_json(Answer, read_json(path), path, "an answer")
            except DataError:
                continue
            if left.pop(answer.task, None) is not None:
                done(answer)
                found += 1
            path.unlink(missing_ok=True)
        return found


@dataclass(frozen=True, slots=True)
class Element:
    """What one element of an array carries out, and the folder for its answers."""

    errands: tuple[Errand, ...]
    answers: Path


def carry_out_element(path: str) -> int:
    """Runs in a job: the tasks of one element; how many there were.

    Args:
        path: The element's file.
    """
    element = from_json(Element, read_json(Path(path)), path, "an element of an array")
    for errand in element.errands:
        write_json(element.answers / f"{uuid.uuid4().hex}.json", to_json(carry_out_here(errand)))
    return len(element.errands)


def _plain(text: str) -> object:
    """A number where the text is one."""
    try:
        return int(text)
    except ValueError:
        return text
