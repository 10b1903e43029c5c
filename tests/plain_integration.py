"""The published bilateral normal integration, written plainly: the oracle of ours."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, diags_array, vstack
from scipy.special import expit


def plain_integration(normals, mask, K, k=2.0, max_iter=100, tol=1e-4):
    """Depth by the iteration as published: Jacobi-preconditioned CG on every pixel."""
    rows, columns = np.nonzero(mask)
    n_x, n_y, n_z = normals[mask].T * np.array([[1.0], [-1.0], [-1.0]])
    ray_x = (columns + 0.5 - K[0, 2]) / K[0, 0]
    ray_y = (rows + 0.5 - K[1, 2]) / K[1, 1]
    facing = n_x * ray_x + n_y * ray_y + n_z
    index = np.full(np.add(mask.shape, 2), -1)
    index[1:-1, 1:-1][mask] = np.arange(len(rows))

    def statement(down, right, scale):
        there = index[rows + 1 + down, columns + 1 + right]
        own = np.flatnonzero(there >= 0)
        entries = np.concatenate([scale[own], -scale[own]])
        places = (np.concatenate([own, own]), np.concatenate([there[own], own]))
        return coo_array((entries, places), shape=(len(rows), len(rows))).tocsr()

    u, v = facing * K[0, 0], facing * K[1, 1]
    each = [statement(*step) for step in ((0, 1, u), (0, -1, -u), (1, 0, v), (-1, 0, -v))]
    system, sides = vstack(each).tocsr(), np.concatenate([-n_x, -n_x, -n_y, -n_y])
    values, weights = np.zeros(len(rows)), np.full(len(sides), 0.5)
    energy = weights @ sides**2
    for _ in range(max_iter):
        weighted = system.T @ diags_array(weights)
        values = jacobi_cg((weighted @ system).tocsr(), weighted @ sides, values)
        right, left, down, up = ((matrix @ values) ** 2 for matrix in each)
        across, along = expit(k * (left - right)), expit(k * (up - down))
        weights = np.concatenate([across, 1 - across, along, 1 - along])
        previous, energy = energy, weights @ (system @ values - sides) ** 2
        if abs(energy - previous) < tol * previous:
            break
    depth = np.full(mask.shape, np.nan)
    depth[mask] = np.exp(values)
    return depth


def jacobi_cg(matrix, target, values):
    inverse = 1.0 / np.maximum(matrix.diagonal(), 1e-5)
    residual = target - matrix @ values
    limit, direction, previous = 1e-3 * np.linalg.norm(target), None, 1.0
    for _ in range(5000):
        if np.linalg.norm(residual) <= limit:
            break
        scaled = inverse * residual
        squared = residual @ scaled
        direction = scaled if direction is None else scaled + squared / previous * direction
        product = matrix @ direction
        length = squared / (direction @ product)
        values, residual = values + length * direction, residual - length * product
        previous = squared
    return values
