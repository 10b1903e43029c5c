"""What training makes small: angles to the truth, and what keeps folds from averaging away.

The chord between unit normals, 2 sin(angle / 2), is nearly the angle, which is what is measured,
and its gradient neither vanishes nor explodes. A network that only minimises angles answers with
smooth maps where it is unsure of a fold's place; ``steps`` compares how normals change between
neighbouring pixels, which smooth maps have wrong everywhere. ``expected`` teaches the network how
large its own error is.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from methods.normals.training.networks.network import Answer
from methods.normals.training.samples import Batch
from methods.normals.training.settings import LossWeights

__all__ = ["Pixels", "chord", "expected", "steps", "total"]

#: At half the photo's resolution, where small folds are seen, the next pixel.
_SPACING_PX = 2


def total(answer: Answer, batch: Batch, weights: LossWeights) -> Tensor:
    """The loss of a network's answer to a batch."""
    sides = (
        (1.0, answer.front, answer.front_error, batch.front, batch.front_inside),
        (weights.back, answer.back, answer.back_error, batch.back, batch.back_inside),
    )
    loss = torch.zeros((), device=batch.image.device)
    for weight, normals, error, true, inside in sides:
        pixels = Pixels.of(inside)
        off = torch.nn.functional.normalize(pixels.rows(normals), dim=1, eps=1e-6)
        off = off - pixels.rows(true)
        chords = chord(off)
        side = _mean(chords) + weights.steps * steps(off, pixels)
        side = side + weights.expected * expected(pixels.rows(error)[:, 0], chords.detach())
        loss = loss + weight * side
    return loss


@dataclass(frozen=True, slots=True, eq=False)
class Pixels:
    """The pixels of a batch that count, in order: most of a picture is empty.

    Attributes:
        where: (N,) their places in the batch's flat masks.
        number: (B, H, W) each pixel's place in ``where``, -1 where it does not count.
    """

    where: Tensor
    number: Tensor

    @classmethod
    def of(cls, inside: Tensor) -> Pixels:
        """Those of masks (B, 1, H, W)."""
        where = torch.nonzero(inside.flatten() > 0)[:, 0]
        number = torch.full_like(inside[:, 0], -1, dtype=torch.long)
        number.view(-1)[where] = torch.arange(len(where), device=where.device)
        return cls(where, number)

    def rows(self, maps: Tensor) -> Tensor:
        """(N, C) float32 of maps (B, C, H, W)."""
        return maps.movedim(1, -1).flatten(0, 2)[self.where].float()

    def pairs(self, axis: int, spacing: int) -> tuple[Tensor, Tensor]:
        """Numbers (M,) of all pixels, and of those that lie some pixels on, that both count."""
        count = max(0, self.number.shape[axis] - spacing)
        first = self.number.narrow(axis, 0, count).flatten()
        second = self.number.narrow(axis, self.number.shape[axis] - count, count).flatten()
        both = torch.nonzero((first >= 0) & (second >= 0))[:, 0]
        return first[both], second[both]


def chord(off: Tensor) -> Tensor:
    """(N,) lengths, 0 to 2, of the differences (N, 3) between unit normals."""
    # The root of exactly nothing has no gradient.
    return (off.square().sum(1) + 1e-6).sqrt()


def steps(off: Tensor, pixels: Pixels) -> Tensor:
    """Mean absolute change, over two pixels, of the differences (N, 3) between normals.

    It is 0 where a map and its truth change alike, whatever lies between them.
    """
    changes = []
    for axis in (1, 2):
        first, second = pixels.pairs(axis, _SPACING_PX)
        changes.append(_mean((off[second] - off[first]).abs().sum(1)))
    return torch.stack(changes).mean()


def expected(predicted: Tensor, actual: Tensor) -> Tensor:
    """How badly predicted errors (N,) fit the actual ones (N,); least where they are their mean.

    The negative logarithm of the likelihood of an exponential distribution.
    """
    predicted = predicted.clamp(min=1e-3)
    return _mean(actual / predicted + predicted.log())


def _mean(values: Tensor) -> Tensor:
    return values.sum() / max(1, len(values))
