"""Smooth random fields in space, the raw material of folds, fabric and skin."""

from __future__ import annotations

import numpy as np

from clothed_avatars.mesh.quads import Floats

_LATTICE = 24


def smooth_noise(points: Floats, seed: int) -> Floats:
    """Values (N,), about -1 to 1, at points (N,3): one bump per unit length, period 24."""
    from scipy.ndimage import map_coordinates

    lattice = np.random.default_rng(seed).uniform(-1, 1, (_LATTICE,) * 3)
    # The cubic spline through random values overshoots little and halves their spread.
    return 1.4 * map_coordinates(lattice, points.T, order=3, mode="grid-wrap")


def folds(points: Floats, seed: int) -> Floats:
    """Ridges 0 to 1 (N,): crests are sharp, valleys wide, as cloth that is pushed together."""
    bend = smooth_noise(points * 0.5, seed + 1)
    crest = 1 - np.abs(smooth_noise(points + 0.35 * bend[:, None], seed))
    fine = 1 - np.abs(smooth_noise(points * 1.9 + 7.3, seed + 2))
    return np.clip(0.75 * crest**2 + 0.35 * fine**2, 0, 1.2)
