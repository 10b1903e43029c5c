"""What a stage costs: wall time, peak memory of the process tree, peak GPU memory."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Iterator

import psutil

from harness.core.artifacts import StageCost

__all__ = ["StageMeter"]

_SAMPLE_S = 0.02
_MIB = 1 << 20


class StageMeter:
    """Collects the cost of stages run one after the other in this process and its children."""

    def __init__(self) -> None:
        self.stages: list[StageCost] = []

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the block as one stage; it is recorded when the block fails, too."""
        peak = _PeakMemory()
        gpu = _Gpu()
        start = time.perf_counter()
        try:
            with peak:
                yield
        finally:
            wall_s = time.perf_counter() - start
            self.stages.append(StageCost(name, wall_s, peak.mib, gpu.peak_mib()))


class _PeakMemory:
    """Samples the resident memory of this process and its children in a thread."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self.mib = self._now()

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._stop.wait(_SAMPLE_S):
            self.mib = max(self.mib, self._now())
        self.mib = max(self.mib, self._now())

    def _now(self) -> float:
        total = 0
        for process in (self._process, *self._process.children(recursive=True)):
            # A child may end between being listed and being asked.
            with contextlib.suppress(psutil.Error):
                total += process.memory_info().rss
        return total / _MIB


class _Gpu:
    """Peak memory that torch allocated on its current CUDA device, if torch is in use at all."""

    def __init__(self) -> None:
        torch = sys.modules.get("torch")
        self._cuda = torch.cuda if torch and torch.cuda.is_available() else None
        if self._cuda:
            self._cuda.reset_peak_memory_stats()

    def peak_mib(self) -> float | None:
        """MiB, or None where no GPU was used."""
        if self._cuda is None:
            return None
        return float(self._cuda.max_memory_allocated()) / _MIB
