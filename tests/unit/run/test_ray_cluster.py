"""What Ctrl-C does in the middle of Ray's own code; no cluster is needed here."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from harness.core.process.interrupts import Interrupted, stopped_by_signals
from harness.run import ray_cluster
from harness.run.progress import Silent
from harness.run.ray_cluster import RayCluster
from harness.run.task import Task


class Connected:
    """A cluster of one core; tasks stay under way, and waiting for them does what a test says."""

    def __init__(self, wait: Callable[[], None]) -> None:
        self._wait = wait
        self.submitted: list[str] = []
        self.cancelled: list[str] = []

    def is_initialized(self) -> bool:
        return True

    def nodes(self) -> list[dict[str, Any]]:
        return [{"Alive": True, "Resources": self.cluster_resources()}]

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 1.0}

    def remote(self, function: object) -> Connected:
        return self

    def options(self, *, name: str, **given: object) -> SimpleNamespace:
        def remote(*values: object) -> str:
            self.submitted.append(name)
            return f"reference to {name}"

        return SimpleNamespace(remote=remote)

    def wait(self, references: list[str], **given: object) -> tuple[list[str], list[str]]:
        self._wait()
        return [], references

    def cancel(self, reference: str, *, force: bool) -> None:
        assert force
        self.cancelled.append(reference)


def test_no_address_starts_a_cluster_even_beside_another(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}
    ray = Connected(interrupted_within)
    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "init", given.update, raising=False)
    monkeypatch.setattr(ray, "shutdown", lambda: None, raising=False)

    with pytest.raises(Interrupted), stopped_by_signals():
        carried_out(ray, monkeypatch)

    assert given["address"] == "local"
    assert given["num_cpus"] == given["resources"]["blender"] >= 1


def interrupted_within() -> None:
    """Ctrl-C comes while Ray waits, which makes another exception of what the handler raises."""
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except Interrupted as stop:
        raise SystemError("returned a result with an exception set") from stop


def interrupted_and_lost() -> None:
    """The same where Ray drops the handler's exception."""
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except Interrupted:
        return


def carried_out(ray: Connected, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_cluster, "extra_package", lambda *names: ray)
    tasks = [Task(name, "never:asked", {}, name) for name in ("a", "b")]
    RayCluster().carry_out(tasks, Silent(), lambda answer: None)


@pytest.mark.parametrize("wait", [interrupted_within, interrupted_and_lost])
def test_ctrl_c_in_the_middle_of_ray_is_an_interruption(
    monkeypatch: pytest.MonkeyPatch, wait: Callable[[], None]
) -> None:
    ray = Connected(wait)

    with pytest.raises(Interrupted) as stopped, stopped_by_signals():
        carried_out(ray, monkeypatch)

    assert stopped.value.exit_code == 130
    assert ray.submitted == ["a", "b"]
    assert ray.cancelled == ["reference to a", "reference to b"]


def test_what_ray_raises_by_itself_stays_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise SystemError("Ray is broken")

    ray = Connected(broken)

    with pytest.raises(SystemError, match="Ray is broken"), stopped_by_signals():
        carried_out(ray, monkeypatch)

    assert ray.cancelled == ["reference to a", "reference to b"]
