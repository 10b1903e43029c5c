"""What makes photos of one surface agree: an exposure for each, and a smooth correction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.core.arrays import Floats, Ints, Singles
from harness.geometry.colours.sights import Sight
from harness.geometry.colours.smoothing import SurfaceGraph

#: Places that two photos must share before they say anything of each other's exposure.
_LEAST_SHARED = 30
#: So many of them are compared.
_MOST_SHARED = 20_000
#: Corrections and blends vary along the surface no faster than this, metres.
_WIDTH_M = 0.03
#: Where photos differ by more than this factor's logarithm, they do not show the same surface.
_MOST = 0.5
#: Weighs gains towards 0, so that photos that share nothing stay as they are.
_RIDGE = 1e-3


def gains(sights: Sequence[Sight]) -> Floats:
    """(S, 3) what to add to each photo's light so that all agree as well as gains can; mean 0.

    Least squares over all pairs of photos of the weighted median of the differences at the places
    that both show.
    """
    count = len(sights)
    normal = np.eye(count) * _RIDGE
    right = np.zeros((count, 3))
    for first in range(count):
        for second in range(first + 1, count):
            found = _difference(sights[first], sights[second])
            if found is None:
                continue
            difference, weight = found
            normal[[first, second], [first, second]] += weight
            normal[[first, second], [second, first]] -= weight
            right[first] += weight * difference
            right[second] -= weight * difference
    solved = np.linalg.solve(normal, right)
    return solved - solved.mean(axis=0)


def _difference(first: Sight, second: Sight) -> tuple[Floats, float] | None:
    """(3,) median by which the second photo is brighter, and the square root of how many tell."""
    shared, one, other = np.intersect1d(
        first.places, second.places, assume_unique=True, return_indices=True
    )
    if len(shared) < _LEAST_SHARED:
        return None
    step = -(-len(shared) // _MOST_SHARED)
    one, other = one[::step], other[::step]
    apart = second.light[other] - first.light[one]
    weight = np.minimum(first.worth[one], second.worth[other])
    middle = [_weighted_median(apart[:, channel], weight) for channel in range(3)]
    return np.array(middle), float(np.sqrt(len(shared)))


def _weighted_median(values: Singles, weights: Singles) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order], dtype=np.float64)
    return float(values[order[np.searchsorted(total, 0.5 * total[-1])]])


def blended(
    sights: Sequence[Sight], lights: Sequence[Singles], weights: Sequence[Singles], count: int
) -> tuple[Floats, Floats]:
    """(count, 3) weighted mean of the photos' light at each place, and (count,) total weight.

    Args:
        sights: Which places each photo shows.
        lights: (N, 3) of each photo.
        weights: (N,) of each photo.
        count: Number of places.
    """
    total = np.zeros(count)
    sums = np.zeros((count, 3))
    for sight, light, weight in zip(sights, lights, weights, strict=True):
        total[sight.places] += weight
        sums[sight.places] += light * weight[:, None]
    return sums / np.where(total > 0, total, 1.0)[:, None], total


def corrections(
    sights: Sequence[Sight], lights: Sequence[Singles], graph: SurfaceGraph
) -> list[Singles]:
    """(N, 3) smooth fields that bring each photo's light to the blend of all.

    The blend weighs a photo less towards the border of what it shows, so that no seam is in it;
    what a photo's light lacks to it is spread along the surface among the places that it shows.

    Args:
        sights: What each photo shows.
        lights: (N, 3) of each photo, with its gain.
        graph: The surface.
    """
    inner = [sight.worth * _innerness(sight.places, graph) for sight in sights]
    target, _ = blended(sights, lights, inner, graph.count)
    return [
        _spread_among(sight, np.clip(target[sight.places] - light, -_MOST, _MOST), graph)
        for sight, light in zip(sights, lights, strict=True)
    ]


def _innerness(places: Ints, graph: SurfaceGraph) -> Singles:
    """(N,) 1 well within the places, near 0 at their border, never 0."""
    shown = np.zeros((graph.count, 1), dtype=np.float32)
    shown[places] = 1.0
    share = graph.spread(shown, _WIDTH_M)[places, 0]
    return np.clip(2.0 * share - 1.0, 1e-3, 1.0)


def _spread_among(sight: Sight, values: Floats, graph: SurfaceGraph) -> Singles:
    """(N, 3) values spread along the surface among the places of a sight, by their worth."""
    held = np.zeros((graph.count, 4), dtype=np.float32)
    worth = sight.worth / sight.worth.max(initial=1e-6)
    held[sight.places, :3] = values * worth[:, None]
    held[sight.places, 3] = worth
    spread = graph.spread(held, _WIDTH_M)[sight.places]
    spread[:, :3] /= np.maximum(spread[:, 3:], 1e-9)
    return spread[:, :3]
