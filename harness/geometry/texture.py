"""Colours of a textured mesh where rays meet it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.mesh import Mesh
from harness.geometry.images import linear_from_srgb
from harness.geometry.raycast import Hits


def linear_texture(texture: NDArray[np.uint8]) -> Floats:
    """(H, W, 3) linear intensities of an sRGB texture (H, W, 3) uint8."""
    return linear_from_srgb(np.arange(256) / 255.0)[texture]


def texture_at(hits: Hits, mesh: Mesh, texture: Floats) -> Floats:
    """(H, W, 3) colour at every hit, bilinear, repeating; 0 where nothing is met.

    Args:
        hits: Where rays meet ``mesh``.
        mesh: With texture coordinates.
        texture: (h, w, 3), in the units that are wanted; see ``linear_texture``.
    """
    from scipy.ndimage import map_coordinates

    assert mesh.uv is not None
    assert mesh.face_uv is not None
    height, width, _ = texture.shape
    u, v = np.moveaxis(hits.interpolate(mesh.uv, mesh.face_uv)[hits.mask], 1, 0)
    # The texture's v grows upward and texel centres lie at half steps.
    where = np.stack([(1.0 - v) * height - 0.5, u * width - 0.5])
    colour = np.zeros((*hits.mask.shape, 3))
    for channel in range(3):
        colour[hits.mask, channel] = map_coordinates(
            texture[..., channel], where, order=1, mode="grid-wrap"
        )
    return colour
