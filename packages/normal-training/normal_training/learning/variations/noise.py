"""Noise where it is needed: drawn by the device that a picture is on."""

from __future__ import annotations

import torch
from torch import Tensor


def noise_like(values: Tensor, draw: torch.Generator) -> Tensor:
    """Normal noise of the shape of some values, on their device.

    Args:
        values: Whose shape and device are wanted.
        draw: Source of randomness, on the processor. Another device draws other numbers from it:
            millions of them would otherwise have to travel.
    """
    if values.device.type == "cpu":
        return torch.randn(values.shape, generator=draw)
    there = torch.Generator(values.device)
    there.manual_seed(int(torch.randint(2**31, (), generator=draw)))
    return torch.randn(values.shape, generator=there, device=values.device)
