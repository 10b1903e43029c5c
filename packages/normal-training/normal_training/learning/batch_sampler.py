"""The batches of a training, step by step, picked ahead where another device does the rest."""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import torch

from harness.core.files.hashing import derive_seed
from normal_training.learning.samples import Batch, Samples
from normal_training.learning.settings import TrainingSettings
from normal_training.learning.variations.drawing import Picked, drawn, pick, varied

#: Steps whose samples are picked while the device works on the ones before.
_AHEAD = 6


class Drawer:
    """Draws each step's batch; what is drawn follows from the step's number alone.

    Args:
        samples: What is drawn from.
        settings: How, and how many in each step.
        device: Where batches are varied and used.
        parts: Number of parts that each step's batch is drawn in.
        ahead: Whether samples are picked before they are asked for; unless given, where the device
            is not the processor.
    """

    def __init__(
        self,
        samples: Samples,
        settings: TrainingSettings,
        device: torch.device,
        parts: int = 1,
        *,
        ahead: bool | None = None,
    ) -> None:
        self._samples, self._settings = samples, settings
        self._device, self._parts = device, parts
        # A processor that learns has no time for more than the next batch.
        ahead = device.type != "cpu" if ahead is None else ahead
        self._pool = ThreadPoolExecutor(os.cpu_count()) if ahead else None
        self._waiting: dict[tuple[int, int], Future[tuple[Picked, torch.Generator]]] = {}

    def batch(self, step: int, part: int = 0) -> tuple[Batch, torch.Generator]:
        """A part of a step's batch, on the device, and the source that it was drawn from."""
        if self._pool is None:
            settings, draw = self._source(step, part)
            return drawn(self._samples, settings, draw, self._device), draw
        picked, draw = self._picked(self._pool, step, part)
        return varied(picked, self._settings, draw), draw

    def _picked(
        self, pool: ThreadPoolExecutor, step: int, part: int
    ) -> tuple[Picked, torch.Generator]:
        for later in range(step, min(step + _AHEAD, self._settings.steps)):
            if (later, part) not in self._waiting:
                self._waiting[later, part] = pool.submit(self._pick, later, part)
        return self._waiting.pop((step, part)).result()

    def _pick(self, step: int, part: int) -> tuple[Picked, torch.Generator]:
        settings, draw = self._source(step, part)
        return pick(self._samples, settings, draw).to(self._device), draw

    def _source(self, step: int, part: int) -> tuple[TrainingSettings, torch.Generator]:
        """The settings of a part, and where its randomness comes from."""
        seed = derive_seed(self._settings.seed, "normal-step", step, part)
        draw = torch.Generator().manual_seed(seed % 2**31)
        count = (self._settings.batch + part) // self._parts
        return replace(self._settings, batch=count), draw
