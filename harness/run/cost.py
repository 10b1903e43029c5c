"""What a stage costs: wall time, peak memory of the process tree, peak GPU memory."""

import contextlib
import sys
import threading
import time
from collections.abc import Iterator, Sequence

import psutil

from harness.core.artifacts import StageCost

_SAMPLE_S = 0.02
_MIB = 1 << 20


class StageMeter:
    """Collects the cost of stages run one after the other in this process and its children."""

    def __init__(self) -> None:
        self.stages: list[StageCost] = []
        self._open = 0
        self._borrowed: list[StageCost] = []
        self._waited_s = 0.0

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the block as one stage; it is recorded when the block fails, too."""
        peak = _PeakMemory()
        gpu = _Gpu()
        before, self._borrowed = self._borrowed, []
        self._open += 1
        start = self._now_s()
        try:
            with peak:
                yield
        finally:
            cost = StageCost(name, self._now_s() - start, peak.mib, gpu.peak_mib())
            self.stages.append(_sum(cost, self._borrowed))
            self._borrowed = before
            self._open -= 1

    @contextlib.contextmanager
    def watched(self, name: str) -> Iterator[list[StageCost]]:
        """Fill a list with the cost of the block: of its stages, or of the whole if it has none.

        Nothing is counted twice: within a stage the block counts as part of that stage.
        """
        own: list[StageCost] = []
        first, peak, gpu, start = len(self.stages), _PeakMemory(), _Gpu(), self._now_s()
        with peak:
            yield own
        whole = StageCost(name, self._now_s() - start, peak.mib, gpu.peak_mib())
        own.extend(self.stages[first:] or [whole])

    @contextlib.contextmanager
    def waiting_for(self, held: contextlib.AbstractContextManager[None]) -> Iterator[None]:
        """Hold something; waiting until it could be had is no part of any stage's time."""
        start = time.perf_counter()
        with held:
            self._waited_s += time.perf_counter() - start
            yield

    def _now_s(self) -> float:
        """A clock that stands still while others are waited for."""
        return time.perf_counter() - self._waited_s

    def add(self, stages: Sequence[StageCost]) -> None:
        """Count work that was done earlier at what it cost then.

        Within a stage it belongs to that stage; otherwise its stages are stages of their own.
        """
        if self._open:
            self._borrowed.extend(stages)
        else:
            self.stages.extend(stages)


def _sum(cost: StageCost, borrowed: Sequence[StageCost]) -> StageCost:
    """A stage with what it borrowed: times add up, of memory the highest counts."""
    gpu = [each.peak_gpu_mib for each in (cost, *borrowed) if each.peak_gpu_mib is not None]
    return StageCost(
        cost.name,
        cost.wall_s + sum(each.wall_s for each in borrowed),
        max(each.peak_rss_mib for each in (cost, *borrowed)),
        max(gpu) if gpu else None,
    )


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
