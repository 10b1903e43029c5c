"""Tasks on a Ray cluster: one that is running, or one that is started on this machine.

Ray runs a task again whose worker or machine was lost. What fails by itself is an answer like any
other and is not tried again. Photos are tasks, and the cells of a subject wait for theirs, so that
no GPU is held while photos are rendered.
"""

import contextlib
import os
import platform
import signal
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from harness.core.errors import HarnessError
from harness.core.process.interrupts import require_not_stopped
from harness.run.progress import Progress
from harness.run.task import Answer, Errand, Grant, Task, carry_out_here, extra_package

#: A resource that clusters may have, so that not too many renderings are on one machine at once.
BLENDER = "blender"
#: How often a task whose worker or machine was lost is tried again.
_RETRIES = 20
#: Tasks that are with Ray, for each core of the cluster; the others wait here.
_WAITING_PER_CORE = 3
_LEAST_WAITING = 16
_POLL_S = 0.25
#: Answers that are fetched at once.
_MOST_AT_ONCE = 64
_MIB, _GIB = 1 << 20, 1 << 30


@dataclass(frozen=True, slots=True)
class RayCluster:
    """A Ray cluster; an ``Executor``.

    Attributes:
        address: ``auto`` for the cluster that this machine belongs to, or that of its head node;
            empty starts one on this machine, which ends with the run.
        grant: What each task may use.
        cores: Cores of a cluster that is started here; 0 takes all.
    """

    address: str = ""
    grant: Grant = field(default_factory=Grant)
    cores: int = 0

    def require_usable(self) -> None:
        """Nothing, if Ray is installed.

        Raises:
            MissingPart: it is not.
        """
        extra_package("ray", "--executor ray")

    def carry_out(
        self, tasks: Sequence[Task], progress: Progress, done: Callable[[Answer], None]
    ) -> None:
        """As ``Executor.carry_out``."""
        # Ray reports its use to its makers otherwise.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        ray = extra_package("ray", "--executor ray")
        if not tasks:
            return
        with _stops_as_such(), self._connected(ray):
            self._require_room(ray, progress)
            with contextlib.closing(_Submitted(ray, self.grant, done)) as submitted:
                submitted.carry_out(tasks)

    @contextlib.contextmanager
    def _connected(self, ray: Any) -> Generator[None]:
        """A connection to the cluster; one that was there before stays."""
        if ray.is_initialized():
            yield
            return
        handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        hook = sys.excepthook
        try:
            ray.init(**self._options(), log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, RuntimeError, ValueError, OSError) as error:
            raise HarnessError(
                f"no Ray cluster could be reached at '{self.address}'"
                if self.address
                else "Ray could not be started on this machine",
                got=str(error).strip().splitlines()[0][:200],
                hint="Start one with: ray start --head; or leave --ray-address out",
            ) from error
        finally:
            # Ray's own would end the process without our goodbye.
            sys.excepthook = hook
            for number, handler in handlers.items():
                signal.signal(number, handler)
        try:
            yield
        finally:
            ray.shutdown()

    def _options(self) -> dict[str, object]:
        if self.address:
            return {"address": self.address}
        cores = self.cores or len(os.sched_getaffinity(0))
        return {
            # Without an address Ray takes a cluster that happens to run on this machine.
            "address": "local",
            "num_cpus": cores,
            # A rendering uses the cores that it is granted, so that there is room for as many.
            "resources": {BLENDER: cores},
            # Values are small: photos and meshes go through files.
            "object_store_memory": 100 * _MIB,
            "include_dashboard": False,
        }

    def _require_room(self, ray: Any, progress: Progress) -> None:
        """Refuse a grant that no machine can give: Ray would wait for one for ever."""
        machines = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        working = [machine for machine in machines if machine.get("CPU", 0) > 0]
        if not working:
            progress.say("the cluster has no machine with cores yet; tasks wait for one")
        elif not any(_fits(self.grant, machine) for machine in working):
            largest = max(working, key=lambda machine: machine["CPU"])
            raise HarnessError(
                "no machine of the cluster has what a cell is granted",
                expected=f"{self.grant.cpus} cores, {self.grant.gpus:g} GPUs, "
                f"{self.grant.memory_gib:g} GiB",
                got=f"at most {largest['CPU']:g} cores, {largest.get('GPU', 0):g} GPUs, "
                f"{largest.get('memory', 0) / _GIB:.1f} GiB",
                hint="Give smaller values for --cell",
            )


@contextlib.contextmanager
def _stops_as_such() -> Generator[None]:
    """Ctrl-C within Ray's own code is an ``Interrupted``.

    Ray runs the handlers of signals in the middle of its calls, and hands on what they raise as an
    exception of another class, or not at all.
    """
    try:
        yield
    except Exception:
        require_not_stopped()
        raise


def _fits(grant: Grant, machine: Mapping[str, float]) -> bool:
    return (
        machine.get("CPU", 0) >= grant.cpus
        and machine.get("GPU", 0) >= grant.gpus
        and machine.get("memory", 0) >= grant.memory_gib * _GIB
    )


def _on_ray(errand: Errand, before: Answer | None = None) -> Answer:
    """One task in a worker of Ray's; ``before`` is the answer of the task that came first."""
    ray = extra_package("ray", "this task")
    node = ray.get_runtime_context().get_node_id()
    value = before.value if before and not before.lost else None
    return carry_out_here(errand, value, f"{platform.node()} ({node[:6]})")


class _Submitted:
    """Tasks that are with Ray.

    Args:
        ray: The package.
        grant: What each task may use.
        done: Receives the answers.
    """

    def __init__(self, ray: Any, grant: Grant, done: Callable[[Answer], None]) -> None:
        self._ray, self._grant, self._done = ray, grant, done
        self._has_blender = BLENDER in ray.cluster_resources()
        self._remote = ray.remote(_on_ray)
        self._pending: dict[Any, str] = {}

    def carry_out(self, tasks: Sequence[Task]) -> None:
        """Hand tasks to Ray as it has room for them, until all have answered."""
        first: tuple[str, Any] = ("", None)
        for task in tasks:
            while len(self._pending) >= self._room():
                self._collect()
            if task.after and task.after != first[0]:
                raise ValueError(f"{task.name} stands apart from {task.after}")
            reference = self._submit(task, first[1] if task.after else None)
            if not task.after:
                first = (task.name, reference)
        while self._pending:
            self._collect()

    def close(self) -> None:
        """End what is still under way."""
        for reference in self._pending:
            self._ray.cancel(reference, force=True)

    def _room(self) -> int:
        cores = self._ray.cluster_resources().get("CPU", 0)
        return max(_LEAST_WAITING, int(_WAITING_PER_CORE * cores))

    def _submit(self, task: Task, before: Any) -> Any:
        grant = self._grant
        options: dict[str, object] = {
            "num_cpus": grant.cpus,
            # Always: a task that asks for none would see all GPUs of its machine.
            "num_gpus": 0 if task.renders else grant.gpus,
            "max_retries": _RETRIES,
            "name": task.name,
        }
        if grant.memory_gib:
            options["memory"] = grant.memory_gib * _GIB
        if task.renders and self._has_blender:
            options["resources"] = {BLENDER: grant.cpus}
        given = (Errand.of(task, grant.cpus), *([] if before is None else [before]))
        reference = self._remote.options(**options).remote(*given)
        self._pending[reference] = task.name
        return reference

    def _collect(self) -> None:
        """Take the answers that are there, and wait for a moment if there is none."""
        # A signal's exception can be lost within Ray.
        require_not_stopped()
        waiting = list(self._pending)
        ready, _ = self._ray.wait(
            waiting, num_returns=min(len(waiting), _MOST_AT_ONCE), timeout=_POLL_S
        )
        for reference in ready:
            name = self._pending.pop(reference)
            self._done(self._answer(name, reference))

    def _answer(self, name: str, reference: Any) -> Answer:
        errors = self._ray.exceptions
        try:
            return self._ray.get(reference)
        except errors.RayTaskError as error:
            return Answer(
                name, lost=f"a defect of this program: {str(error).strip().splitlines()[-1]}"
            )
        except errors.RayError as error:
            reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
            return Answer(name, lost=f"its worker was lost {_RETRIES + 1} times: {reason}")
