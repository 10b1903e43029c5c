"""Adam's steps, bit for bit torch's own on a processor, without its compiler.

Torch's optimisers import ``torch._dynamo``, two seconds of a processor, only to say what it is to
leave alone; so does RoMa (``harness.core.missing``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

_FIRST, _SECOND, _LEAST = 0.9, 0.999, 1e-8
#: Less progress than this share is none.
_PROGRESS = 1e-4


class Adam:
    """AMSGrad: Adam with the largest second moment so far (Reddi et al., ICLR 2018).

    Args:
        parameters: Tensors on the processor that want gradients; moved in place.
        rate: Length of the first step.
    """

    def __init__(self, parameters: Iterable[Tensor], rate: float) -> None:
        self.rate = rate
        self._parameters = tuple(parameters)
        self._moments = [tuple(p.detach() * 0.0 for _ in range(3)) for p in self._parameters]
        self._steps = 0

    def zero_grad(self) -> None:
        """Forget the gradients."""
        for parameter in self._parameters:
            parameter.grad = None

    def step(self) -> None:
        """Move each parameter that has a gradient."""
        import torch

        self._steps += 1
        length = self.rate / (1 - _FIRST**self._steps)
        root = (1 - _SECOND**self._steps) ** 0.5
        with torch.no_grad():
            for parameter, (mean, square, most) in zip(
                self._parameters, self._moments, strict=True
            ):
                if (gradient := parameter.grad) is not None:
                    mean.lerp_(gradient, 1 - _FIRST)
                    square.mul_(_SECOND).addcmul_(gradient, gradient, value=1 - _SECOND)
                    torch.maximum(most, square, out=most)
                    spread = (most.sqrt() / root).add_(_LEAST)
                    parameter.addcdiv_(mean, spread, value=-length)


class Plateau:
    """Shortens steps by a factor where the cost has not fallen for more than ``patience`` steps."""

    def __init__(self, optimiser: Adam, factor: float, patience: int, least: float) -> None:
        self._optimiser, self._factor, self._patience = optimiser, factor, patience
        self._least_rate, self._best, self._bad = least, math.inf, 0

    def step(self, cost: float) -> None:
        """Take note of a cost."""
        if cost < self._best * (1 - _PROGRESS):
            self._best, self._bad = cost, 0
        else:
            self._bad += 1
        if self._bad > self._patience:
            self._bad = 0
            self._optimiser.rate = max(self._optimiser.rate * self._factor, self._least_rate)


def cosine(rate: float, step: int, steps: int, least: float) -> float:
    """The rate after ``step`` of ``steps``, from the one before; ends at ``least``."""
    before = 1 + math.cos(math.pi * (step - 1) / steps)
    return (1 + math.cos(math.pi * step / steps)) / before * (rate - least) + least
