"""Measuring two ways of doing one thing in turns, so that a ratio of them can be asserted."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import pytest


@dataclass(frozen=True)
class Turns:
    """What each way took and made.

    Attributes:
        seconds: By way, one entry a round.
        cpu_seconds: The same in processor time of this process.
        results: By way, what its last round returned.
    """

    seconds: Mapping[str, list[float]]
    cpu_seconds: Mapping[str, list[float]]
    results: Mapping[str, Any]

    def least_s(self, way: str) -> float:
        """The cost of a way: its fastest round, which other work disturbed least."""
        return min(self.seconds[way])

    def ratio(self, way: str, other: str) -> float:
        """How many times as long ``way`` takes as ``other``."""
        return self.least_s(way) / self.least_s(other)

    def cpu_ratio(self, way: str, other: str) -> float:
        """The same in processor time."""
        return min(self.cpu_seconds[way]) / min(self.cpu_seconds[other])


@pytest.fixture
def in_turns() -> Callable[..., Turns]:
    """Runs ways in turns (A, B, A, B, ...): whatever else the machine does meets all of them."""

    def measure(ways: Mapping[str, Callable[[], Any]], rounds: int = 3) -> Turns:
        seconds: dict[str, list[float]] = {way: [] for way in ways}
        cpu_seconds: dict[str, list[float]] = {way: [] for way in ways}
        results: dict[str, Any] = {}
        for _ in range(rounds):
            for way, work in ways.items():
                start, cpu_start = time.perf_counter(), time.process_time()
                results[way] = work()
                seconds[way].append(time.perf_counter() - start)
                cpu_seconds[way].append(time.process_time() - cpu_start)
        return Turns(seconds, cpu_seconds, results)

    return measure
