"""How a normal network is trained; needs no PyTorch, so that a command line can offer it."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["TrainingSettings"]


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """How a network is trained.

    Attributes:
        steps: Number of optimiser steps.
        batch: Number of samples in each step.
        width_px: Columns of a sample that a step sees, at random: most are empty.
        rate: Greatest learning rate (AdamW; warm-up, then a half cosine).
        decay: Weight decay.
        judge_every: Steps between two looks at the held-out subjects; a checkpoint each.
        seed: Seed of weights, order and augmentation.
    """

    steps: int = 1500
    batch: int = 8
    width_px: int = 256
    rate: float = 1.5e-3
    decay: float = 1e-2
    judge_every: int = 100
    seed: int = 0
