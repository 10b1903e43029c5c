"""Muon: steps along the orthogonal matrix nearest to the momentum of each weight's gradient.

All directions that a layer has seen then move by the same amount, not only the strongest. Biases
and thin layers, for which that makes no sense, take AdamW's steps.

Source: Jordan et al., "Muon: An optimizer for hidden layers in neural networks" (2024); the scale
of the steps, which makes AdamW's rates and decay fit, is that of Liu et al., "Muon is scalable for
LLM training" (2025).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor, nn

__all__ = ["Muon", "orthogonal"]

_MOMENTUM = 0.95
_ADAM_MEANS = (0.9, 0.95)
_RMS = 0.2
#: Weights with fewer rows or columns have no directions worth balancing.
_LEAST_SIDE = 16
_ITERATIONS = 5
_QUINTIC = (3.4445, -4.7750, 2.0315)


class Muon(torch.optim.Optimizer):
    """An optimiser for convolutional networks.

    Args:
        parameters: Of the network.
        lr: Learning rate, as for AdamW.
        weight_decay: As for AdamW.
    """

    def __init__(self, parameters: Iterable[nn.Parameter], lr: float, weight_decay: float) -> None:
        super().__init__(parameters, {"lr": lr, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:  # type: ignore[override] - no closure is used
        """Move every parameter that has a gradient."""
        assert closure is None
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is None:
                    continue
                change = self._change(parameter)
                parameter.mul_(1.0 - group["lr"] * group["weight_decay"])
                parameter.sub_(change, alpha=group["lr"])

    def _change(self, parameter: Tensor) -> Tensor:
        state, gradient = self.state[parameter], parameter.grad
        assert gradient is not None
        if not state:
            state["step"] = 0
            state["mean"] = torch.zeros_like(gradient)
        state["step"] += 1
        if parameter.ndim > 1 and min(len(parameter), parameter[0].numel()) >= _LEAST_SIDE:
            state["mean"].mul_(_MOMENTUM).add_(gradient)
            ahead = (gradient + _MOMENTUM * state["mean"]).flatten(1)
            scale = _RMS * max(ahead.shape) ** 0.5
            return scale * orthogonal(ahead).to(gradient.dtype).view_as(gradient)
        if "square" not in state:
            state["square"] = torch.zeros_like(gradient)
        first, second = _ADAM_MEANS
        state["mean"].lerp_(gradient, 1.0 - first)
        state["square"].lerp_(gradient.square(), 1.0 - second)
        mean = state["mean"] / (1.0 - first ** state["step"])
        root = (state["square"] / (1.0 - second ** state["step"])).sqrt()
        return mean / (root + 1e-8)


def orthogonal(matrix: Tensor) -> Tensor:
    """A matrix with the singular vectors of another (M, N), all singular values about 1.

    Five steps of a Newton-Schulz iteration in bfloat16: the values end between 0.7 and 1.2, which
    is as good as 1 for an optimiser. A matrix of zeros stays so.
    """
    a, b, c = _QUINTIC
    rows, columns = matrix.shape
    value = matrix.bfloat16()
    value = value / (value.norm() + 1e-7)
    if rows > columns:
        value = value.T
    for _ in range(_ITERATIONS):
        square = value @ value.T
        value = a * value + (b * square + c * square @ square) @ value
    return value.T if rows > columns else value
