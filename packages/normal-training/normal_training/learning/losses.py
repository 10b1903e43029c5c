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

from normal_training.learning.networks.network import Answer
from normal_training.learning.samples import Batch
from normal_training.learning.settings import LossWeights

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
        pixels = counted_pixels(inside)
        off = torch.nn.functional.normalize(pixels.rows(normals), dim=1, eps=1e-6)
        off = off - pixels.rows(true)
        chords = chord(off)
        side = pixels.mean(chords) + weights.steps * steps(off, pixels)
        surprise = expected(pixels.rows(error)[:, 0], chords.detach())
        loss = loss + weight * (side + weights.expected * pixels.mean(surprise))
    return loss


def counted_pixels(inside: Tensor) -> Pixels | AllPixels:
    """Those of masks (B, 1, H, W) as their device does least with them.

    A processor leaves out what does not count. A graphics processor would have to be waited for to
    know how many that are, and has looked at all of them before.
    """
    return AllPixels(inside) if inside.is_cuda else Pixels.of(inside)


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

    def mean(self, values: Tensor) -> Tensor:
        """Mean of values (N,), 0 of none."""
        return values.sum() / max(1, len(values))

    def mean_change(self, rows: Tensor, axis: int, spacing: int) -> Tensor:
        """Mean absolute change of rows (N, C) along an axis, summed over their components."""
        first, second = self.pairs(axis, spacing)
        return self.mean((rows[second] - rows[first]).abs().sum(1))


class AllPixels:
    """The same as ``Pixels``, with all pixels as rows, of which those outside weigh nothing.

    Args:
        inside: (B, 1, H, W) masks.
    """

    def __init__(self, inside: Tensor) -> None:
        self._inside = (inside[:, 0] > 0).float()

    def rows(self, maps: Tensor) -> Tensor:
        """See ``Pixels``; 1 outside, so that nothing there can spoil a sum."""
        known = torch.where(self._inside[:, None] > 0, maps.float(), 1.0)
        return known.movedim(1, -1).flatten(0, 2)

    def mean(self, values: Tensor) -> Tensor:
        """See ``Pixels``."""
        return _weighted(values, self._inside.flatten())

    def mean_change(self, rows: Tensor, axis: int, spacing: int) -> Tensor:
        """See ``Pixels``."""
        maps = rows.view(*self._inside.shape, -1)
        count = max(0, maps.shape[axis] - spacing)
        start = maps.shape[axis] - count
        change = maps.narrow(axis, start, count) - maps.narrow(axis, 0, count)
        both = self._inside.narrow(axis, start, count) * self._inside.narrow(axis, 0, count)
        return _weighted(change.abs().sum(-1).flatten(), both.flatten())


def _weighted(values: Tensor, weights: Tensor) -> Tensor:
    return (values * weights).sum() / weights.sum().clamp(min=1.0)


def chord(off: Tensor) -> Tensor:
    """(N,) lengths, 0 to 2, of the differences (N, 3) between unit normals."""
    # The root of exactly nothing has no gradient.
    return (off.square().sum(1) + 1e-6).sqrt()


def steps(off: Tensor, pixels: Pixels | AllPixels) -> Tensor:
    """Mean absolute change, over two pixels, of the differences (N, 3) between normals.

    It is 0 where a map and its truth change alike, whatever lies between them.
    """
    return torch.stack([pixels.mean_change(off, axis, _SPACING_PX) for axis in (1, 2)]).mean()


def expected(predicted: Tensor, actual: Tensor) -> Tensor:
    """(N,) how badly predicted errors (N,) fit the actual ones (N,); least where these are means.

    The negative logarithm of the likelihood of an exponential distribution.
    """
    predicted = predicted.clamp(min=1e-3)
    return actual / predicted + predicted.log()
