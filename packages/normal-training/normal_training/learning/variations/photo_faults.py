"""What cameras, files and masks do to a photo, drawn anew each time a sample is used.

Samples are clean pictures with exact masks; photographs are blurred, small, noisy, sharpened and
compressed, masks are off by a pixel or two with the background showing in the rim, and some
photographs cut feet or head.
"""

from __future__ import annotations

import torch
from torch import Tensor

from normal_training.learning.settings import FaultShares
from normal_training.learning.variations.jpeg import compressed
from normal_training.learning.variations.noise import noise_like

_BLUR_PX = (0.4, 1.3)
_SMALLER = (0.4, 0.85)
_GRAIN = (0.01, 0.06)
_SHARPEN = (0.3, 1.2)
_QUALITY = (25, 85)
_RIM_PX = (1, 2)
_CUT = (0.05, 0.3)


def spoilt(
    image: Tensor, mask: Tensor, draw: torch.Generator, shares: FaultShares
) -> tuple[Tensor, Tensor]:
    """A picture and its mask with drawn faults.

    Args:
        image: (3, H, W) sRGB in [-1, 1], 0 outside the mask.
        mask: (1, H, W) 1 inside, 0 outside.
        draw: Source of randomness.
        shares: How often each fault occurs.

    Returns:
        Image and mask of the same sizes; the image is 0 outside the new mask.
    """

    def happens(share: float) -> bool:
        return bool(torch.rand((), generator=draw) < share)

    def between(bounds: tuple[float, float]) -> float:
        low, high = bounds
        return low + (high - low) * float(torch.rand((), generator=draw))

    # Light is added up over what the lens mixes: with black beside the subject, as in the samples.
    light = (image + mask) / 2.0
    if happens(shares.small):
        light = _smaller(light, between(_SMALLER))
    if happens(shares.blur):
        light = _blurred(light, between(_BLUR_PX))
    if happens(shares.sharp):
        light = light + between(_SHARPEN) * (light - _blurred(light, 1.0))
    if happens(shares.grain):
        noise = noise_like(light, draw)
        light = light + between(_GRAIN) * _blurred(noise, between((0.3, 0.9)))
    if happens(shares.packed):
        light = compressed(light, round(between(_QUALITY)))
    wanted = mask
    if happens(shares.rim):
        wanted = _moved(mask, round(between(_RIM_PX)), outward=happens(0.5))
        beyond = torch.rand(3, 1, 1, generator=draw).to(light.device)
        light = torch.where(mask > 0, light, beyond)
    if happens(shares.cut):
        wanted = _cut(wanted, between(_CUT), top=happens(0.3))
    return (2.0 * light.clamp(0.0, 1.0) - 1.0) * wanted, wanted


def _blurred(light: Tensor, sigma: float) -> Tensor:
    reach = 3
    offsets = torch.arange(-reach, reach + 1, dtype=torch.float32, device=light.device)
    weights = torch.exp(-0.5 * (offsets / sigma) ** 2)
    weights = weights / weights.sum()
    rows = light[:, None]
    padded = torch.nn.functional.pad(rows, (reach, reach, reach, reach), mode="replicate")
    across = torch.nn.functional.conv2d(padded, weights.view(1, 1, 1, -1))
    return torch.nn.functional.conv2d(across, weights.view(1, 1, -1, 1))[:, 0]


def _smaller(light: Tensor, factor: float) -> Tensor:
    resized = torch.nn.functional.interpolate(
        light[None], scale_factor=factor, mode="bilinear", antialias=True
    )
    return torch.nn.functional.interpolate(resized, size=light.shape[1:], mode="bilinear")[0]


def _moved(mask: Tensor, pixels: int, *, outward: bool) -> Tensor:
    """The mask grown or shrunk by some pixels."""
    size = 2 * pixels + 1
    if outward:
        return torch.nn.functional.max_pool2d(mask[None], size, 1, pixels)[0]
    return 1.0 - torch.nn.functional.max_pool2d(1.0 - mask[None], size, 1, pixels)[0]


def _cut(mask: Tensor, share: float, *, top: bool) -> Tensor:
    """The mask without a share of the subject's rows, at the head or at the feet."""
    # Numbers stay where the mask is: another device need not be waited for.
    height = mask.shape[1]
    rows = torch.arange(height, device=mask.device)
    there = mask[0].amax(dim=1) > 0
    first = torch.where(there, rows, height).min()
    last = torch.where(there, rows + 1, 0).max()
    lost = (share * (last - first).clamp(min=0)).int()
    kept = rows >= first + lost if top else rows < last - lost
    return mask * kept[None, :, None]
