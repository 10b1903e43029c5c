"""Which views are matched with which: beside each other, neither too near nor too far round."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera

#: Seen from the subject. Nearer views hardly tell depth; further ones show other surfaces.
_LEAST_DEG, _MOST_DEG = 10.0, 65.0
#: With eight even views, the next ones, 45 degrees away, are the ones to match.
_BEST_DEG = 35.0


def neighbours(cameras: Sequence[Camera], centre: Floats) -> list[tuple[int, ...]]:
    """For each view the views it is matched with: the best one, and the best on its other side.

    Args:
        cameras: Cameras of all views.
        centre: (3,) of the subject, world metres.

    Returns:
        No, one or two indices for each view; none where all others are too near or too far round.
    """
    eyes = np.stack([camera.position for camera in cameras]) - centre
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True)
    return [_beside(eyes, view) for view in range(len(cameras))]


def _beside(eyes: Floats, view: int) -> tuple[int, ...]:
    angle = np.degrees(np.arccos(np.clip(eyes @ eyes[view], -1.0, 1.0)))
    usable = np.flatnonzero((angle >= _LEAST_DEG) & (angle <= _MOST_DEG))
    if len(usable) == 0:
        return ()
    # Rounded, so that views at equal angles keep the order of their numbers.
    order = usable[np.argsort(np.round(np.abs(angle[usable] - _BEST_DEG), 6), kind="stable")]
    across = eyes[order] - (eyes[order] @ eyes[view])[:, None] * eyes[view]
    opposite = np.flatnonzero(across @ across[0] < 0)
    return (int(order[0]), *(int(order[other]) for other in opposite[:1]))


def pairs(found: Sequence[tuple[int, ...]]) -> list[tuple[int, int]]:
    """Every pair of matched views once, the lower number first, sorted."""
    return sorted({(min(a, b), max(a, b)) for a, others in enumerate(found) for b in others})
