"""The ramp of k, where we leave the published iteration, costs neither error nor energy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import label

from methods.surface.bilateral import Schedule, integrate
from methods.surface.integration import focal_length, tangent_planes

AS_PUBLISHED = {"ramp": ()}


def pile_of_balls(seed: int, size: int, K: np.ndarray):
    """Depth, normals and mask (largest part) of four balls that hide parts of each other."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    rays = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], axis=-1)
    depth, normals = np.full((size, size), np.inf), np.zeros((size, size, 3))
    for _ in range(4):
        centre = np.append(rng.uniform(-0.3, 0.3, 2), rng.uniform(2.8, 3.2))
        radius = rng.uniform(0.25, 0.45)
        a, b, c = (rays**2).sum(axis=-1), rays @ centre, centre @ centre - radius**2
        hit = b * b > a * c
        near = np.where(hit, (b - np.sqrt(np.where(hit, b * b - a * c, 0.0))) / a, np.inf)
        first = near < depth
        depth[first] = near[first]
        normals[first] = (near[first, None] * rays[first] - centre) / radius
    parts = label(np.isfinite(depth))[0]
    mask = parts == 1 + np.bincount(parts.ravel())[1:].argmax()  # balls apart tell nothing
    return np.where(mask, depth, np.nan), normals * (1.0, -1.0, -1.0), mask


@pytest.mark.slow
def test_the_ramp_costs_neither_error_nor_energy() -> None:
    size = 110
    width = size + 1  # an odd number of columns, as the lattice needs
    K = np.array([[2.0 * size, 0, size / 2], [0, 2.0 * size, size / 2], [0, 0, 1]])
    errors, energies = [], []
    for seed in range(30):
        truth, normals, mask = (
            np.pad(array, ((0, 0), (0, width - size)) + ((0, 0),) * (array.ndim - 2))
            for array in pile_of_balls(seed, size, K)
        )
        planes = tangent_planes(normals, mask, (0, 0), K)
        pair = []
        for options in ({}, AS_PUBLISHED):
            values, history = integrate(planes, Schedule(2.0, 100, 1e-4, **options))
            depth = np.exp(values / focal_length(K))
            scale = np.median(truth[mask] / depth[mask])
            pair.append((np.abs(depth * scale - truth)[mask].mean(), history[-1]))
        errors.append(pair[0][0] / pair[1][0])
        energies.append(pair[0][1] / pair[1][1])
    assert np.exp(np.log(errors).mean()) < 1.005
    assert max(errors) < 1.1
    assert np.mean(energies) < 1.001
