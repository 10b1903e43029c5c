"""Stored photos in another light: light adds up, so each kind of it is stored by itself.

A photo is the surface's own colour times what arrives from the sky, from the ground and from each
lamp, shadows included. Other strengths and colours of these make another photo of the same scene,
in a hundredth of the time that the first one took.
"""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Bytes, Floats, Singles
from harness.geometry.images import linear_from_srgb
from methods.normals.training.variations.light import (
    Lamp,
    drawn_lamp_colour,
    light_of,
    photographed,
)

__all__ = ["LAMPS", "packed_lights", "relit", "unpacked_lights"]

LAMPS = 2
"""Number of lamps whose light is stored with a photo."""

#: Share of the lamps that shine.
_SHINING = 0.7
_NOWHERE = np.zeros((0, 3))

_LINEAR = linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)
_SQUARES = ((np.arange(256) / 255.0) ** 2).astype(np.float32)


def packed_lights(lights: Floats) -> Bytes:
    """Shares of light, 0 to 1, as bytes; their roots, because eyes and photos tell dark ones apart.

    ``unpacked_lights`` is their inverse.
    """
    return np.round(255.0 * np.sqrt(np.clip(lights, 0.0, 1.0))).astype(np.uint8)


def unpacked_lights(lights: Bytes) -> Singles:
    """The shares behind ``packed_lights``."""
    return _SQUARES[lights]


def relit(albedo: Bytes, lights: Bytes, coverage: Bytes, draw: np.random.Generator) -> Bytes:
    """(N, 3) sRGB bytes of pixels in a drawn light, blended over black by their coverage.

    Args:
        albedo: (N, 3) the surface's own colour, sRGB bytes.
        lights: (N, 2 + L) how much arrives from sky, ground and lamps; see ``packed_lights``.
        coverage: (N,) share of the pixel that the subject covers, in steps of 1/255.
        draw: Source of randomness.
    """
    lamps = lights.shape[1] - 2
    shining = draw.random(lamps) < _SHINING
    light = light_of(
        tuple(Lamp(_NOWHERE, drawn_lamp_colour(draw)) for _ in range(shining.sum())), draw
    )
    kept = np.concatenate([[True, True], shining])
    arriving = unpacked_lights(lights[:, kept]) @ light.colours.astype(np.float32)
    picture = photographed(_LINEAR[albedo] * arriving, light, draw)
    return np.round(picture * coverage[:, None]).astype(np.uint8)
