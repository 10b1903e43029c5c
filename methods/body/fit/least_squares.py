"""Levenberg and Marquardt's method for robust sums of squares of a body's parameters.

A fit that descends for a number of steps ends somewhere near a minimum, and grain of a photo or
another processor's rounding decides where. This one goes on to the minimum, in double precision:
where landmarks differ by a hundredth of a pixel, joints differ by tenths of a millimetre.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from methods.body.models.model import Parameters

if TYPE_CHECKING:
    from torch import Tensor

#: Step of the finite differences, in each parameter's own unit (radians, metres, shape values).
_STEP = 1e-6
_MOST_ROUNDS, _MOST_TRIES = 150, 10
#: A round that lowers the cost by less than this share of it is the last, if its derivatives were
#: worked out anew; else they are, after a round that lowers it by less than the second share.
_SETTLED, _SLOW = 1e-7, 1e-2


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """What B sets of parameters leave over.

    Attributes:
        robust: Groups (B, G, D) whose lengths cost half the logarithm of 1 + their square (Cauchy),
            and their weights (G,).
        plain: (B, L) that cost half their square.
    """

    robust: tuple[tuple[Tensor, Tensor], ...]
    plain: Tensor

    def cost(self) -> Tensor:
        """(B,) the sum of all costs."""
        total = 0.5 * (self.plain**2).sum(1)
        for group, weight in self.robust:
            total = total + 0.5 * (weight * (group**2).sum(2).log1p()).sum(1)
        return total

    def rows(self) -> Tensor:
        """(B, M) all numbers."""
        import torch

        return torch.cat([self.plain, *(group.flatten(1) for group, _ in self.robust)], 1)

    def weights(self) -> Tensor:
        """(M,) those of iteratively reweighted least squares at the first set.

        With them the squares' gradient is the gradient of the cost.
        """
        import torch

        weights = [torch.ones_like(self.plain[0])]
        for group, weight in self.robust:
            share = weight / (1.0 + (group[0] ** 2).sum(1))
            weights.append(share[:, None].expand(group.shape[1:]).flatten())
        return torch.cat(weights)


class Problem(Protocol):
    """What is to be minimised."""

    def about(self, parameters: Parameters) -> None:
        """Called with the parameters (1, ...) of each round: what is held fixed around them."""
        ...

    def residuals(self, parameters: Parameters) -> Residuals:
        """What parameters (B, ...) leave over."""
        ...


def minimum(problem: Problem, start: Parameters) -> tuple[dict[str, Tensor], float]:
    """The parameters (1, ...) of the minimum that a start (1, ...) leads to, and their cost.

    Args:
        problem: What is minimised.
        start: Any precision; the result has double precision.
    """
    import torch

    with torch.no_grad():
        return _Search(problem, start).run()


class _Search:
    """The way from a start to a minimum."""

    def __init__(self, problem: Problem, start: Parameters) -> None:
        import torch

        self._problem = problem
        self._shapes = {name: value.shape[1:] for name, value in start.items()}
        self._at = torch.cat([value.detach().double().flatten() for value in start.values()])
        self._damping = 1e-2

    def run(self) -> tuple[dict[str, Tensor], float]:
        """As ``minimum``."""
        import torch

        jacobian, fresh = None, False
        for _ in range(_MOST_ROUNDS):
            self._problem.about(self._unpacked(self._at[None]))
            here = self._left(self._at[None])
            if jacobian is None:
                jacobian, fresh = self._jacobian(), True
            step, there = self._tried(here, jacobian, _MOST_TRIES if fresh else 1)
            gain = float(here.cost() - there.cost())
            if gain > 0:
                self._at, self._damping = self._at + step, max(self._damping / 5, 1e-7)
            if gain > (_SETTLED if fresh else _SLOW) * float(here.cost()):
                # Broyden's update: the differences along the step, for a ninetieth of the work.
                missed = there.rows()[0] - here.rows()[0] - jacobian @ step
                jacobian, fresh = jacobian + torch.outer(missed, step) / (step @ step), False
            elif fresh:
                break
            else:
                jacobian = None
        return self._unpacked(self._at[None]), float(self._left(self._at[None]).cost())

    def _tried(
        self, here: Residuals, jacobian: Tensor, most_tries: int
    ) -> tuple[Tensor, Residuals]:
        """A step that lowers the cost, if one is found, and what is left over there."""
        import torch

        weighed = here.weights()[:, None] * jacobian
        normal, slope = jacobian.T @ weighed, weighed.T @ here.rows()[0]
        step, there = torch.zeros_like(slope), here
        for _ in range(most_tries):
            damped = normal + torch.diag(self._damping * normal.diagonal() + 1e-9)
            step = -torch.linalg.solve(damped, slope)
            there = self._left((self._at + step)[None])
            if float(there.cost()) < float(here.cost()):
                break
            self._damping *= 4
        return step, there

    def _jacobian(self) -> Tensor:
        """(M, P) by finite differences, all at once."""
        import torch

        moved = self._at + _STEP * torch.eye(len(self._at), dtype=self._at.dtype)
        rows = self._left(torch.cat([self._at[None], moved])).rows()
        return ((rows[1:] - rows[0]) / _STEP).T

    def _left(self, rows: Tensor) -> Residuals:
        return self._problem.residuals(self._unpacked(rows))

    def _unpacked(self, rows: Tensor) -> dict[str, Tensor]:
        parts = rows.split([shape.numel() for shape in self._shapes.values()], 1)
        return {
            name: part.reshape(-1, *shape)
            for (name, shape), part in zip(self._shapes.items(), parts, strict=True)
        }
