"""Stored photos in another light: light adds up, so each kind of it is stored by itself.

A photo is the surface's own colour times what arrives from the sky, from the ground and from each
lamp, shadows included. Other strengths and colours of these make another photo of the same scene,
in a hundredth of the time that the first one took.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from harness.geometry.images import linear_from_srgb
from normal_training.learning.variations.light import Lamp, Light, drawn_lamp_colour, light_of
from normal_training.learning.variations.noise import noise_like

#: Share of the lamps that shine.
_SHINING = 0.7
_NOWHERE = np.zeros((0, 3))
#: Below it, sRGB is a straight line (IEC 61966-2-1).
_DARK = 0.0031308

_LINEAR = torch.from_numpy(linear_from_srgb(np.arange(256) / 255.0)).float()


def unpacked_lights(lights: Tensor) -> Tensor:
    """The shares behind ``light.packed_lights``."""
    return (lights.float() / 255.0).square()


def relit(albedo: Tensor, lights: Tensor, coverage: Tensor, draw: torch.Generator) -> Tensor:
    """(N, 3) sRGB bytes of pixels in a drawn light, blended over black by their coverage.

    Args:
        albedo: (N, 3) the surface's own colour, sRGB bytes.
        lights: (N, 2 + L) how much arrives from sky, ground and lamps; see ``light.packed_lights``.
        coverage: (N,) share of the pixel that the subject covers, in steps of 1/255.
        draw: Source of randomness, on the processor.
    """
    device = albedo.device
    chance = np.random.default_rng(int(torch.randint(2**31, (), generator=draw)))
    lamps = lights.shape[1] - 2
    shining = chance.random(lamps) < _SHINING
    light = light_of(
        tuple(Lamp(_NOWHERE, drawn_lamp_colour(chance)) for _ in range(shining.sum())), chance
    )
    colours = np.zeros((2 + lamps, 3), np.float32)
    colours[np.concatenate([[True, True], shining])] = light.colours
    arriving = unpacked_lights(lights) @ torch.from_numpy(colours).to(device)
    picture = developed(_LINEAR.to(device)[albedo.long()] * arriving, light, draw)
    return (picture * coverage[:, None]).round().byte()


def developed(linear: Tensor, light: Light, draw: torch.Generator) -> Tensor:
    """``light.photographed`` on a device: colours in [0, 1], sRGB, of linear light (..., 3)."""
    exposed = (light.exposure * linear).clamp(0.0, 1.0)
    bright = 1.055 * exposed.clamp(min=_DARK) ** (1 / 2.4) - 0.055
    picture = torch.where(exposed <= _DARK, 12.92 * exposed, bright) ** light.contrast
    return (picture + light.noise * noise_like(picture, draw)).clamp(0.0, 1.0)
