"""Normals of a depth map from its own grid: oriented by construction, without guessing a side."""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.cameras.camera import Camera

#: Determinant of the window's spread of pixels, px^4, below which they are on one line.
_ON_ONE_LINE = 1e-3


def grid_normals(depth: Floats, mask: Mask, camera: Camera, radius_px: int) -> Floats:
    """(H, W, 3) unit world normals towards the camera; 0 where they cannot be told.

    The inverse depth of a plane is linear over a picture. In the window around each pixel that
    linear function is fitted to the pixels of the mask, and the plane's normal follows: exact for
    planes at any angle, and of the least squares where depth is noisy.

    Args:
        depth: (H, W) along the optical axis, positive inside the mask.
        mask: (H, W) which pixels count.
        camera: Camera of these pixels.
        radius_px: Half the window; 1 takes 3 x 3 pixels.
    """
    from scipy.ndimage import uniform_filter

    normals = np.zeros((*depth.shape, 3))
    if not mask.any():
        return normals
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    inside = mask[window].astype(np.float64)
    inverse = np.where(mask[window], 1.0 / np.where(mask[window], depth[window], 1.0), 0.0)
    # From the window's own corner: squares of small numbers lose fewer digits.
    v, u = np.indices(inside.shape, dtype=np.float64)

    def mean(values: Floats) -> Floats:
        found = uniform_filter(inside * values, 2 * radius_px + 1, mode="constant")
        return np.asarray(found)

    share = np.maximum(mean(np.ones_like(inside)), 1e-9)
    mu, mv, mw = mean(u) / share, mean(v) / share, mean(inverse) / share
    uu, vv = mean(u * u) / share - mu * mu, mean(v * v) / share - mv * mv
    uv = mean(u * v) / share - mu * mv
    uw, vw = mean(u * inverse) / share - mu * mw, mean(v * inverse) / share - mv * mw
    spread = uu * vv - uv * uv
    good = (spread > _ON_ONE_LINE) & mask[window]
    safe = np.where(good, spread, 1.0)
    across, down = (vv * uw - uv * vw) / safe, (uu * vw - uv * uw) / safe
    at_corner = mw - across * (mu + columns[0] + 0.5) - down * (mv + rows[0] + 0.5)
    # 1 / z = n . K^-1 (x, y, 1) / d, so the fitted plane is K^-T n / d.
    in_camera = -np.stack([across, down, at_corner], axis=-1) @ camera.K
    length = np.linalg.norm(in_camera, axis=-1, keepdims=True)
    good &= length[..., 0] > 0
    in_camera = np.where(good[..., None], in_camera / np.maximum(length, 1e-300), 0.0)
    normals[window] = in_camera @ camera.rotation
    return normals
