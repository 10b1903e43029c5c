"""The batches of a training, step by step, picked ahead where another device does the rest."""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import torch

from harness.core.files.hashing import derive_seed
from methods.normals.training.samples import Batch, Samples
from methods.normals.training.settings import TrainingSettings
from methods.normals.training.variations.drawing import Picked, pick, varied

__all__ = ["Drawer"]

#: Steps whose samples are picked while the device works on the ones before.
_AHEAD = 6


class Drawer:
    """Draws each step's batch; what is drawn follows from the step's number alone.

    Args:
        samples: What is drawn from.
        settings: How, and how many in each step.
        device: Where batches are varied and used.
        parts: Number of parts that each step's batch is drawn in.
    """

    def __init__(
        self, samples: Samples, settings: TrainingSettings, device: torch.device, parts: int = 1
    ) -> None:
        self._samples, self._settings = samples, settings
        self._device, self._parts = device, parts
        # A processor that learns has no time for more than the next batch.
        self._pool = None if device.type == "cpu" else ThreadPoolExecutor(os.cpu_count())
        self._waiting: dict[tuple[int, int], Future[tuple[Picked, torch.Generator]]] = {}

    def batch(self, step: int, part: int = 0) -> tuple[Batch, torch.Generator]:
        """A part of a step's batch, on the device, and the source that it was drawn from."""
        picked, draw = self._picked(step, part)
        return varied(picked, self._settings, draw), draw

    def _picked(self, step: int, part: int) -> tuple[Picked, torch.Generator]:
        if self._pool is None:
            return self._pick(step, part)
        for later in range(step, min(step + _AHEAD, self._settings.steps)):
            if (later, part) not in self._waiting:
                self._waiting[later, part] = self._pool.submit(self._pick, later, part)
        return self._waiting.pop((step, part)).result()

    def _pick(self, step: int, part: int) -> tuple[Picked, torch.Generator]:
        seed = derive_seed(self._settings.seed, "normal-step", step, part)
        draw = torch.Generator().manual_seed(seed % 2**31)
        count = (self._settings.batch + part) // self._parts
        picked = pick(self._samples, replace(self._settings, batch=count), draw)
        return picked.to(self._device), draw
