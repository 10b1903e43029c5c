"""Closed-form views: surfaces whose depth and normals are known at every pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from harness.core.arrays import Floats


@dataclass(frozen=True)
class View:
    """Depth and map-frame normals of one surface; NaN and 0 outside the mask."""

    mask: NDArray[np.bool_]
    depth: Floats
    normals: Floats
    facing: Floats  # cosine between normal and line of sight


@pytest.fixture(scope="session")
def camera_matrix() -> Callable[[int, float], Floats]:
    """K of a square image with slightly different focal lengths and an off-centre axis."""

    def build(size: int, focal: float) -> Floats:
        return np.array(
            [[focal * size, 0, 0.52 * size], [0, focal * 1.02 * size, 0.47 * size], [0, 0, 1]]
        )

    return build


@pytest.fixture(scope="session")
def ellipsoid() -> Callable[..., tuple[View, View]]:
    """Near and far side of an axis-aligned ellipsoid (x right, y down, z away)."""

    def build(
        size: int, centre: tuple[float, ...], radii: tuple[float, ...], K: Floats | None
    ) -> tuple[View, View]:
        origin, rays = _sight(size, K)
        offset, shape = origin - np.array(centre), 1.0 / np.array(radii) ** 2
        a = (rays * rays * shape).sum(axis=-1)
        b = (rays * offset * shape).sum(axis=-1)
        c = (offset * offset * shape).sum(axis=-1) - 1.0
        squared = b * b - a * c
        mask = squared > 0
        root = np.sqrt(np.where(mask, squared, 0.0))
        return tuple(
            _view(mask, (-b + sign * root) / a, rays, lambda p: (p - centre) * shape, origin)
            for sign in (-1, 1)
        )

    return build


@pytest.fixture(scope="session")
def log_relief() -> Callable[..., View]:
    """The view whose depth in pixels, or log depth times focal length, is a given relief."""

    def build(relief: Floats, slope_x: Floats, slope_y: Floats, K: Floats | None) -> View:
        mask = np.ones(relief.shape, dtype=bool)
        _, rays = _sight(len(relief), K)
        if K is None:
            normals = np.stack([slope_x, slope_y, np.full(relief.shape, -1.0)], axis=-1)
            return _finished(mask, relief, normals, rays)
        focal = np.sqrt(K[0, 0] * K[1, 1])
        p, q = slope_x * K[0, 0] / focal, slope_y * K[1, 1] / focal
        # n.r = -1 and n_x = f_x d(log z)/du say that the normal is square to the surface.
        normals = np.stack([p, q, -1.0 - p * rays[..., 0] - q * rays[..., 1]], axis=-1)
        return _finished(mask, np.exp(relief / focal), normals, rays)

    return build


def _sight(size: int, K: Floats | None) -> tuple[Floats, Floats]:
    x, y = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    nothing, one = np.zeros_like(x), np.ones_like(x)
    if K is None:
        return np.stack([x, y, nothing], axis=-1), np.stack([nothing, nothing, one], axis=-1)
    rays = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], one], axis=-1)
    return np.zeros_like(rays), rays


def _view(mask, depth, rays, gradient, origin) -> View:
    points = origin + depth[..., None] * rays
    return _finished(mask, depth, gradient(points), rays)


def _finished(mask, depth, normals, rays) -> View:
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    facing = np.abs((normals * rays).sum(axis=-1)) / np.linalg.norm(rays, axis=-1)
    in_map = normals * (1.0, -1.0, -1.0)
    return View(mask, np.where(mask, depth, np.nan), np.where(mask[..., None], in_map, 0.0), facing)
