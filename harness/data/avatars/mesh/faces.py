"""Which face lies across which side, and what hangs together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.core.errors import DataError
from harness.data.avatars.mesh.quads import Ints

__all__ = ["connected", "neighbours", "without_islands"]


def neighbours(faces: Ints) -> Ints:
    """(F,3) the face across each side of each face of a closed surface."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(sides.T[::-1])
    ranked = sides[order]
    if (
        len(sides) % 2
        or not (ranked[0::2] == ranked[1::2]).all()
        or (ranked[2::2] == ranked[1:-1:2]).all(1).any()
    ):
        raise DataError("the surface to unwrap is not closed", expected="two faces at every edge")
    pairs = order.reshape(-1, 2)
    across = np.empty(len(sides), np.int64)
    across[pairs[:, 0]], across[pairs[:, 1]] = pairs[:, 1] // 3, pairs[:, 0] // 3
    return across.reshape(-1, 3)


def connected(label: Ints, across: Ints) -> Ints:
    """The connected set (F,) of equally labelled faces that each face belongs to."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    face = np.repeat(np.arange(len(label)), 3)
    same = label[face] == label[across.ravel()]
    size = len(label)
    graph = coo_matrix(
        (np.ones(int(same.sum())), (face[same], across.ravel()[same])), shape=(size, size)
    )
    return connected_components(graph, directed=False)[1]


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
