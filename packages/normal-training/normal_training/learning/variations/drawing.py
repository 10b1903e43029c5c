"""Batches of samples: picked by the processor, varied on any device, in other light too.

What is drawn follows from the source of randomness alone, so that batches can be picked ahead, in
any order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from harness.geometry.window import Window
from normal_training.learning.samples import (
    NORMALS,
    Arrays,
    Batch,
    Samples,
    batch_of,
    stacked,
)
from normal_training.learning.settings import FaultShares, TrainingSettings
from normal_training.learning.variations.photo_faults import spoilt
from normal_training.learning.variations.relighting import relit
from normal_training.learning.variations.turning import Placement, drawn_placement

#: A pixel of a turned mask is inside if so much of it is.
_COVERED = 0.5
_LIT = ("albedo", "lights", "coverage")
#: Standard deviations of the logarithms of each colour's gain, and of the picture's exponent.
_GAIN, _EXPONENT = 0.15, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """What puts a sample into another light: bytes of all its pixels, as ``relit`` takes them."""

    albedo: Tensor
    lights: Tensor
    coverage: Tensor

    @classmethod
    def of(cls, arrays: Arrays) -> Lit:
        """That of a sample (H, W, ...)."""
        found = (torch.from_numpy(np.array(arrays[name])) for name in _LIT)
        return cls(*(values.flatten(0, 1) for values in found))

    def to(self, device: torch.device) -> Lit:
        """The same on a device."""
        return Lit(*(getattr(self, name).to(device) for name in _LIT))


@dataclass(frozen=True, slots=True, eq=False)
class Picked:
    """Samples, or windows of them, that become a batch.

    Attributes:
        maps: Theirs, stacked: (B, H, W, ...) by the names that ``batch_of`` takes.
        relit: What is needed of those that are put into another light, by their numbers.
        rim_px: What lies around each of them and is cut away after it was turned.
    """

    maps: dict[str, Tensor]
    relit: dict[int, Lit]
    rim_px: int

    def to(self, device: torch.device) -> Picked:
        """The same on a device: bytes travel, a quarter of what they become there."""
        maps = {name: values.to(device) for name, values in self.maps.items()}
        relit = {number: lit.to(device) for number, lit in self.relit.items()}
        return Picked(maps, relit, self.rim_px)


def drawn(
    samples: Samples,
    settings: TrainingSettings,
    draw: torch.Generator,
    device: torch.device | None = None,
) -> Batch:
    """Some samples in varied light, with a camera's faults, turned, half of them mirrored.

    Args:
        samples: What is drawn from.
        settings: Their number, which part of them is seen, and what varies how much.
        draw: Source of randomness, on the processor.
        device: Of the batch; the processor unless given.
    """
    picked = pick(samples, settings, draw)
    return varied(picked if device is None else picked.to(device), settings, draw)


def pick(samples: Samples, settings: TrainingSettings, draw: torch.Generator) -> Picked:
    """What a batch is made from; the first half of ``drawn``, which needs no device."""
    windows = settings.windows
    near = windows.wide_near
    is_near = bool(torch.rand((), generator=draw) < windows.near_share)
    is_near = is_near and near[0] <= samples.whole.width and near[1] <= samples.whole.height
    taken = (_near if is_near else _strips)(samples, settings, draw)
    chosen = torch.nonzero(torch.rand(len(taken), generator=draw) < settings.relit)[:, 0]
    others = {number: Lit.of(taken[number]) for number in chosen.tolist()}
    return Picked(stacked(taken), others, windows.rim_px if is_near else 0)


def varied(picked: Picked, settings: TrainingSettings, draw: torch.Generator) -> Batch:
    """The batch, on the device; the second half of ``drawn``, with the same source as the first."""
    batch = batch_of(picked.maps)
    count, device = len(batch.mask), batch.mask.device
    place = drawn_placement(count, settings.turning, draw, device)
    for number, lit in picked.relit.items():
        _relight(batch.image[number], batch.mask[number], lit, draw)
    batch = _placed(batch, place)
    if picked.rim_px:
        batch = _trimmed(batch, picked.rim_px)
    batch = replace(batch, image=_recoloured(batch.image, batch.mask, draw))
    batch = _photographed(batch, draw, settings.faults)
    mirrored = (torch.rand(count, generator=draw) < 0.5).to(device)
    return Batch(
        *(
            _mirrored(getattr(batch, field.name), mirrored, normals=field.name in NORMALS)
            for field in fields(batch)
        )
    )


def _strips(samples: Samples, settings: TrainingSettings, draw: torch.Generator) -> list[Arrays]:
    """Samples of full height."""
    whole = samples.whole
    width = min(settings.windows.strip_px, whole.width)
    left = _below(whole.width - width + 1, draw)
    window = Window(left, 0, width, whole.height)
    return [samples.taken(_below(len(samples), draw), window) for _ in range(settings.batch)]


def _near(samples: Samples, settings: TrainingSettings, draw: torch.Generator) -> list[Arrays]:
    """More samples, each around one of the subject's pixels, of as many pixels in all."""
    windows, whole = settings.windows, samples.whole
    strip = min(windows.strip_px, whole.width) * whole.height
    count = round(settings.batch * strip / math.prod(windows.near_px))
    return [
        _around(samples, _below(len(samples), draw), windows.wide_near, draw) for _ in range(count)
    ]


def _around(samples: Samples, index: int, size: tuple[int, int], draw: torch.Generator) -> Arrays:
    whole = samples.whole
    pixels = np.flatnonzero(samples.mask(index))
    middle = divmod(int(pixels[_below(len(pixels), draw)]), whole.width)
    top, left = (
        corner(at, side, most)
        for at, side, most in zip(middle, size[::-1], (whole.height, whole.width), strict=True)
    )
    return samples.taken(index, Window(left, top, *size))


def corner(middle: int, side: int, most: int) -> int:
    """Where a window of a side begins, around a pixel of a picture that is at least as long."""
    return min(max(middle - side // 2, 0), most - side)


def _below(count: int, draw: torch.Generator) -> int:
    return int(torch.randint(count, (), generator=draw))


def _relight(image: Tensor, mask: Tensor, lit: Lit, draw: torch.Generator) -> None:
    """Put a sample's photo (3, H, W) into another light, inside its mask (1, H, W)."""
    rows = relit(lit.albedo, lit.lights, lit.coverage, draw)
    picture = rows.view(*mask.shape[1:], 3).movedim(-1, 0)
    image.copy_((picture.float() / 127.5 - 1.0) * mask)


def _trimmed(batch: Batch, rim_px: int) -> Batch:
    """The batch without its rim."""
    inner = slice(rim_px, -rim_px or None)
    return Batch(*(getattr(batch, field.name)[:, :, inner, inner] for field in fields(batch)))


def _recoloured(image: Tensor, mask: Tensor, draw: torch.Generator) -> Tensor:
    """Pictures under other light and in other colours: gains, an exponent, exchanged channels."""
    count, device = len(image), image.device
    gain = torch.exp(_GAIN * torch.randn(count, 3, 1, 1, generator=draw)).to(device)
    exponent = torch.exp(_EXPONENT * torch.randn(count, 1, 1, 1, generator=draw)).to(device)
    order = torch.argsort(torch.rand(count, 3, generator=draw), dim=1).to(device)
    mixed = torch.stack([picture[rows] for picture, rows in zip(image, order, strict=True)])
    light = ((mixed + 1.0) / 2.0 * gain).clamp(1e-4, 1.0) ** exponent
    return (2.0 * light - 1.0) * mask


def _placed(batch: Batch, place: Placement) -> Batch:
    """The batch turned and enlarged."""
    # Light adds up where colours blend, beside the subject with black.
    light = (batch.image + batch.mask) / 2.0
    normals = [getattr(batch, name) for name in NORMALS]
    light, mask, *normals = place.moved(
        [light, batch.mask, *normals], turning=[False, False, *[True] * len(normals)]
    )
    mask = (mask >= _COVERED).float()
    found = dict(zip(NORMALS, normals, strict=True))
    inside = {
        f"{side}_inside": mask * (found[side].abs().sum(1, keepdim=True) > 0)
        for side in ("front", "back")
    }
    return Batch(image=(2.0 * light - 1.0) * mask, mask=mask, **found, **inside)


def _photographed(batch: Batch, draw: torch.Generator, faults: FaultShares) -> Batch:
    """The batch as cameras and masks spoil it; what they lose is not asked for."""
    pairs = [
        spoilt(image, mask, draw, faults)
        for image, mask in zip(batch.image, batch.mask, strict=True)
    ]
    image, mask = (torch.stack(list(maps)) for maps in zip(*pairs, strict=True))
    # A fitted body goes on where the frame cuts the person, but its map ends there too.
    rows = mask.amax(dim=3, keepdim=True)
    return replace(
        batch,
        image=image.contiguous(memory_format=torch.channels_last),
        mask=mask,
        body_front=batch.body_front * rows,
        body_back=batch.body_back * rows,
        front_inside=batch.front_inside * mask,
        back_inside=batch.back_inside * mask,
    )


def _mirrored(values: Tensor, chosen: Tensor, *, normals: bool) -> Tensor:
    """The chosen ones of a batch seen in a mirror; normals then point the other way along x."""
    other = values.flip(3)
    if normals:
        other = other * torch.tensor([-1.0, 1.0, 1.0], device=values.device).view(1, 3, 1, 1)
    return torch.where(chosen.view(-1, 1, 1, 1), other, values)
