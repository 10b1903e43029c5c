"""Which face lies across which side, and what hangs together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.core.arrays import Ints
from harness.core.errors import DataError
from harness.geometry.coinciding import components, edges_of


def neighbours(faces: Ints) -> Ints:
    """(F,3) the face across each side of each face of a closed surface."""
    edges = edges_of(faces)
    if (edges.counts != 2).any():
        raise DataError("the surface to unwrap is not closed", expected="two faces at every edge")
    both = edges.faces().sum(axis=1)
    return both[edges.of_side] - np.arange(len(faces))[:, None]


def connected(label: Ints, across: Ints) -> Ints:
    """The connected set (F,) of equally labelled faces that each face belongs to."""
    face = np.repeat(np.arange(len(label)), 3)
    same = label[face] == label[across.ravel()]
    return components(len(label), face[same], across.ravel()[same]).astype(np.int64)


def without_islands(
    label: Ints, across: Ints, least: int, spared: Sequence[int] = (), rounds: int = 8
) -> Ints:
    """Labels (F,) in which sets of fewer than ``least`` faces took their surroundings' label.

    Labels that are ``spared`` may be as small as they are.
    """
    count = int(label.max()) + 1
    for _ in range(rounds):
        piece = connected(label, across)
        small = (np.bincount(piece)[piece] < least) & ~np.isin(label, spared)
        if not small.any():
            break
        votes = np.zeros((int(piece.max()) + 1, count))
        inside = small[:, None] & (label[across] != label[:, None])
        np.add.at(votes, (np.repeat(piece, 3)[inside.ravel()], label[across][inside]), 1)
        change = small & (votes[piece].sum(1) > 0)
        label = np.where(change, votes[piece].argmax(1), label)
    return label
