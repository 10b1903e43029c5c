"""Muon: steps along the orthogonal matrix nearest to the momentum of each weight's gradient.

All directions that a layer has seen then move by the same amount, not only the strongest. Biases
and thin layers, for which that makes no sense, take AdamW's steps.

Source: Jordan et al., "Muon: An optimizer for hidden layers in neural networks" (2024); the scale
of the steps, which makes AdamW's rates and decay fit, is that of Liu et al., "Muon is scalable for
LLM training" (2025).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

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
            moved = [parameter for parameter in group["params"] if parameter.grad is not None]
            for parameter, change in zip(moved, self._changes(moved), strict=True):
                parameter.mul_(1.0 - group["lr"] * group["weight_decay"])
                parameter.sub_(change, alpha=group["lr"])

    def _changes(self, parameters: Sequence[Tensor]) -> list[Tensor]:
        changes = [self._direction(parameter) for parameter in parameters]
        matrices = [number for number, each in enumerate(parameters) if _has_directions(each)]
        flat = [changes[number].flatten(1) for number in matrices]
        for number, found in zip(matrices, _all_orthogonal(flat), strict=True):
            scale = _RMS * max(found.shape) ** 0.5
            parameter = parameters[number]
            changes[number] = scale * found.to(parameter.dtype).view_as(parameter)
        return changes

    def _direction(self, parameter: Tensor) -> Tensor:
        """The momentum of a matrix, ahead of its step; else AdamW's step."""
        state, gradient = self.state[parameter], parameter.grad
        assert gradient is not None
        if not state:
            state["step"] = 0
            state["mean"] = torch.zeros_like(gradient)
        state["step"] += 1
        if _has_directions(parameter):
            state["mean"].mul_(_MOMENTUM).add_(gradient)
            return gradient + _MOMENTUM * state["mean"]
        if "square" not in state:
            state["square"] = torch.zeros_like(gradient)
        first, second = _ADAM_MEANS
        state["mean"].lerp_(gradient, 1.0 - first)
        state["square"].lerp_(gradient.square(), 1.0 - second)
        mean = state["mean"] / (1.0 - first ** state["step"])
        root = (state["square"] / (1.0 - second ** state["step"])).sqrt()
        return mean / (root + 1e-8)


def _has_directions(parameter: Tensor) -> bool:
    return parameter.ndim > 1 and min(len(parameter), parameter[0].numel()) >= _LEAST_SIDE


def _all_orthogonal(matrices: Sequence[Tensor]) -> list[Tensor]:
    """``orthogonal`` of each, those of one shape at once: they are many and small."""
    alike: dict[torch.Size, list[int]] = {}
    for number, matrix in enumerate(matrices):
        alike.setdefault(matrix.shape, []).append(number)
    found = list(matrices)
    for numbers in alike.values():
        together = orthogonal(torch.stack([matrices[number] for number in numbers]))
        for number, matrix in zip(numbers, together, strict=True):
            found[number] = matrix
    return found


def orthogonal(matrix: Tensor) -> Tensor:
    """A matrix with the singular vectors of another (..., M, N), all singular values about 1.

    Five steps of a Newton-Schulz iteration in bfloat16: the values end between 0.7 and 1.2, which
    is as good as 1 for an optimiser. A matrix of zeros stays so.
    """
    a, b, c = _QUINTIC
    rows, columns = matrix.shape[-2:]
    value = matrix.bfloat16()
    value = value / (value.norm(dim=(-2, -1), keepdim=True) + 1e-7)
    if rows > columns:
        value = value.mT
    for _ in range(_ITERATIONS):
        square = value @ value.mT
        value = a * value + (b * square + c * square @ square) @ value
    return value.mT if rows > columns else value
