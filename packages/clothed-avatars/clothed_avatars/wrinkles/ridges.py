"""The first shape of folds: noise drawn out across the direction in which cloth is pushed together.

Relaxation alone would fold cloth at the width of its mesh and in no direction. The ridges give
folds a width and let them run as drag lines do: white noise is diffused along the edges that have
little surplus, and hardly along those that have much.
"""

from __future__ import annotations

import numpy as np

from clothed_avatars.mesh.quads import Floats
from clothed_avatars.wrinkles.relaxation import Springs

_ALONG = 0.75
"""Reach of the diffusion along ridges, as a share of the folds' width."""
_LEAST = 0.006
"""Exchange across ridges, as a share of that along them: it reaches 0.12 of the folds' width, which
makes noise whose waves are about that wide.
"""
_FOCUS = 8
"""How quickly the exchange falls with the surplus: diagonals must not blur ridges along edges."""
_RATE = 0.11
"""Exchange with one neighbour per step; eight neighbours must stay below 1."""


def surplus_of_vertices(net: Springs, surplus: Floats) -> Floats:
    """(V,) the largest surplus (E,) of the edges at each vertex, evened out over its neighbours."""
    largest = np.zeros(net.means.shape[0])
    for end in net.ends.T:
        np.maximum.at(largest, end, surplus)
    return net.means @ largest


def ridges(net: Springs, surplus: Floats, lengths: Floats, wave_m: float, seed: int) -> Floats:
    """(V,) heights in metres of ridges about ``wave_m`` wide that use up the surplus (E,).

    A wave of length w and height a makes cloth longer by the share (pi a / w)^2, which gives the
    ridges' height. lengths (E,): of the edges, metres.
    """
    from scipy.sparse import coo_matrix, diags

    size = net.means.shape[0]
    full = surplus_of_vertices(net, surplus)
    first, second = net.ends.T
    most = np.maximum(0.5 * (full[first] + full[second]), 1e-6)
    across = np.clip(surplus / most, 0, 1)
    rate = _RATE * (_LEAST + (1 - _LEAST) * (1 - across) ** _FOCUS)
    rows, columns = np.concatenate([first, second]), np.concatenate([second, first])
    exchange = coo_matrix((np.tile(rate, 2), (rows, columns)), shape=(size, size)).tocsr()
    step = diags(1 - np.asarray(exchange.sum(1)).ravel()) + exchange
    spacing = float(np.median(lengths))
    count = max(4, round((_ALONG * wave_m / spacing) ** 2 / (2 * _RATE)))
    heights = np.random.default_rng(seed).normal(size=size)
    for _ in range(count):
        heights = step @ heights
    heights -= heights.mean()
    heights /= max(float(heights.std()), 1e-12)
    return wave_m / np.pi * np.sqrt(np.maximum(full, 0) / 2) * np.clip(heights, -2.5, 2.5)
