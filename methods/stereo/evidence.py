"""How far offsets are believed: what two groups of views say apart, held against each other.

A surface is moved only as far as views that had no part in an offset would move it, too. Let one
group of views say a and another b of the same vertex, both the true offset plus errors of their
own. The mean square of a - b is twice the variance of the errors, that of a and b the variance of
the truth plus once that of the errors; the share of the truth in (a + b) / 2 follows from the two
(Wiener's weight). Noise, wrong cameras, stripes and skin without texture all lower it by
themselves, and where the groups contradict each other nothing moves. What all views have in common
is not seen: cameras that are wrong by several pixels, but agree, shift the surface with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from methods.stereo.membrane import Neighbourhood

#: Over how many neighbours the two are averaged: about 3 cm of surface.
_SPREAD = 12
#: Offsets below this need no proof, metres: they change nothing that can be measured.
_NOTHING_M = 0.0003
#: A neighbourhood with less than this share of vertices that both groups see follows the whole.
_ENOUGH = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How two groups of views agree on the offsets of a surface.

    Attributes:
        share: (V,) 0 to 1, by how much each vertex' offset is believed.
        overall: The same of the whole surface.
        error_m: Standard deviation of one group's offsets, from their differences; NaN where no
            vertex is seen by both.
        compared: Share of the vertices that both groups see.
    """

    share: Floats
    overall: float
    error_m: float
    compared: float


def agreement(first: Floats, second: Floats, around: Neighbourhood) -> Agreement:
    """How far the offsets of two groups of views are believed.

    Args:
        first: (V,) metres; NaN where the group says nothing.
        second: (V,) the same of the other group.
        around: Neighbours in the mesh whose vertices they move.
    """
    both = np.isfinite(first) & np.isfinite(second)
    if not both.any():
        return Agreement(np.zeros(len(first)), 0.0, float("nan"), 0.0)
    apart = np.square(np.where(both, first - second, 0.0))
    size = np.where(both, (first**2 + second**2) / 2.0, 0.0)
    overall = float(_truth_share(apart[both].mean(), size[both].mean()))
    weight = around.averaged(both.astype(np.float64), _SPREAD)
    near = _truth_share(
        around.averaged(apart, _SPREAD) / np.maximum(weight, 1e-9),
        around.averaged(size, _SPREAD) / np.maximum(weight, 1e-9),
    )
    return Agreement(
        share=np.where(weight > _ENOUGH, near, overall),
        overall=overall,
        # The median is not the few wrong ones': 0.6745 of a normal distribution's deviation.
        error_m=float(np.median(np.sqrt(apart[both])) / 0.6745 / np.sqrt(2.0)),
        compared=float(both.mean()),
    )


def _truth_share(apart: Floats | np.floating, size: Floats | np.floating) -> Floats:
    """Wiener's weight of a mean of two, from mean squares of their difference and of their size."""
    truth = size + _NOTHING_M**2 - apart / 2.0
    return np.clip(truth / np.maximum(truth + apart / 4.0, 1e-12), 0.0, 1.0)
