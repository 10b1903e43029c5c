"""A Ray cluster of simulated nodes on this machine, whose nodes and workers can be lost."""

from __future__ import annotations

import contextlib
import os
import random
from collections.abc import Iterator, Mapping
from typing import Any

import psutil

_MIB = 1 << 20
#: How often a node is started until one has.
_STARTS = 6


class Nodes:
    """A Ray cluster of simulated nodes on this machine, of one core each.

    Args:
        count: How many.
        unheard: Ray gives up a node that it has not heard from so often, once a second.
    """

    def __init__(self, count: int, unheard: int = 3) -> None:
        from ray.cluster_utils import Cluster

        # A lost node is noticed after some seconds instead of a quarter of a minute.
        health = {
            "health_check_initial_delay_ms": 0,
            "health_check_period_ms": 1000,
            "health_check_timeout_ms": 2000,
            "health_check_failure_threshold": unheard,
        }
        store = 80 * _MIB
        head = {
            "num_cpus": 0,
            "object_store_memory": store,
            "_system_config": health,
            "include_dashboard": False,
            "include_log_monitor": False,
        }
        self._cluster: Any = None
        for _ in range(_STARTS):
            # Ray gives a node half a minute, which is little on a machine with other work.
            with contextlib.suppress(Exception):
                self._cluster = Cluster(initialize_head=True, head_node_args=head)
                break
        else:
            raise TimeoutError(f"no Ray head started on this machine in {_STARTS} attempts")
        self._store = store
        self._nodes: list[Any] = []
        for _ in range(count):
            self.add()

    @property
    def address(self) -> str:
        """For ``--ray-address``."""
        return str(self._cluster.address)

    def add(self) -> None:
        """One node more."""
        for _ in range(_STARTS):
            with contextlib.suppress(Exception):
                node = self._cluster.add_node(
                    num_cpus=1, object_store_memory=self._store, include_log_monitor=False
                )
                self._nodes.append(node)
                return
        raise TimeoutError(f"no Ray node started on this machine in {_STARTS} attempts")

    def remove(self, dice: random.Random) -> None:
        """One node less, as if its power were cut."""
        node = self._nodes.pop(dice.randrange(len(self._nodes)))
        self._cluster.remove_node(node, allow_graceful=False)

    def replace_given_up(self) -> int:
        """A new node for each that has ended because Ray gave it up; how many there were."""
        ended = [node for node in self._nodes if not node.remaining_processes_alive()]
        for node in ended:
            self._nodes.remove(node)
            with contextlib.suppress(Exception):
                # It has ended, and what is left of it may end meanwhile.
                self._cluster.remove_node(node, allow_graceful=False)
            self.add()
        return len(ended)

    @staticmethod
    def kill_worker(dice: random.Random) -> bool:
        """Kill a worker of ours that is at work; whether there was one."""
        busy = workers_at_work()
        with contextlib.suppress(psutil.Error):
            if busy:
                dice.choice(busy).kill()
                return True
        return False

    def close(self) -> None:
        """End all."""
        self._cluster.shutdown()


def workers_at_work() -> list[psutil.Process]:
    """Ray's workers below this process that have a task of ours."""
    busy: list[psutil.Process] = []
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            # Ray shows the task's name there.
            title = " ".join(process.cmdline())
            if title.startswith("ray::") and " on t" in title:
                busy.append(process)
    return busy


@contextlib.contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """The block's environment, with some values; the one before comes back."""
    before = dict(os.environ)
    os.environ.update(values)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
