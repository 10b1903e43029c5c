"""Training samples in memory, drawn in batches and varied as they are drawn."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from harness.core.array_files.npz import read_required_arrays
from harness.core.errors import DataError
from harness.geometry.window import Window
from methods.normals.training.settings import FaultShares, TrainingSettings
from methods.normals.training.variations.photo_faults import spoilt
from methods.normals.training.variations.relighting import relit
from methods.normals.training.variations.turning import Placement, drawn_placement

__all__ = ["Batch", "Samples", "read_samples"]

#: Of one subject, or of a window of one of its samples.
Arrays = dict[str, np.ndarray]

_MAPS = ("rgb", "mask", "front", "back", "body_front", "body_back")
_ARRAYS = (*_MAPS, "albedo", "lights", "coverage")
_NORMALS = ("body_front", "body_back", "front", "back")
_STEPS = 127.0
#: A pixel of a turned mask is inside if so much of it is.
_COVERED = 0.5
#: Standard deviations of the logarithms of each colour's gain, and of the picture's exponent.
_GAIN, _EXPONENT = 0.15, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Float tensors (B, C, H, W), as the network takes them, and what it should answer.

    Attributes:
        image: sRGB in [-1, 1], 0 outside the mask.
        mask: 1 inside, 0 outside.
        body_front, body_back: Unit normals of a fitted body, 0 where there is none.
        front, back: Unit normals of the clothed subject.
        front_inside, back_inside: Where these are known and asked for.
    """

    image: Tensor
    mask: Tensor
    body_front: Tensor
    body_back: Tensor
    front: Tensor
    back: Tensor
    front_inside: Tensor
    back_inside: Tensor

    def to(self, device: torch.device) -> Batch:
        """The same on a device."""
        return Batch(*(getattr(self, field.name).to(device) for field in fields(self)))


class Samples:
    """All samples of some subjects.

    Args:
        files: Arrays by the names of ``harness.pipeline.training.samples.make_samples``, of one
            size, for each subject.
        keys: Content ids of the files.
    """

    def __init__(self, files: Sequence[Arrays], keys: Sequence[str]) -> None:
        # Each file's arrays as they are: together they are many gigabytes, and twice that in one.
        self._places = [(file, row) for file in files for row in range(len(file["rgb"]))]
        height, width = files[0]["rgb"].shape[1:3]
        self._whole = Window.whole((width, height))
        self.keys = tuple(keys)

    @classmethod
    def load(cls, paths: Sequence[Path]) -> Samples:
        """The samples of some files, which must be of one size.

        Raises:
            DataError: a file that is not one of samples, or of another size than the first.
        """
        files = [read_samples(path) for path in paths]
        sizes = {file["rgb"].shape[1:3] for file in files}
        if len(sizes) != 1:
            raise DataError(
                "training samples are of different sizes",
                expected="one size",
                got=", ".join(f"{width} x {height}" for height, width in sorted(sizes)),
            )
        return cls(files, [str(file["key"]) for file in files])

    def __len__(self) -> int:
        return len(self._places)

    def at(self, indices: Iterable[int]) -> Batch:
        """The samples at some indices, as they are."""
        return _batch([self._taken(index, self._whole) for index in indices])

    def drawn(self, settings: TrainingSettings, draw: torch.Generator) -> Batch:
        """Some samples in varied light, with a camera's faults, turned, half of them mirrored.

        Args:
            settings: Their number, which part of them is seen, and what varies how much.
            draw: Source of randomness.
        """
        windows = settings.windows
        near = windows.wide_near
        is_near = bool(torch.rand((), generator=draw) < windows.near_share)
        is_near = is_near and near[0] <= self._whole.width and near[1] <= self._whole.height
        taken = (self._near if is_near else self._strips)(settings, draw)
        for arrays in taken:
            if torch.rand((), generator=draw) < settings.relit:
                _relight(arrays, draw)
        batch = _placed(_batch(taken), drawn_placement(len(taken), settings.turning, draw))
        if is_near:
            batch = _trimmed(batch, windows.rim_px)
        batch = replace(batch, image=_recoloured(batch.image, batch.mask, draw))
        batch = _photographed(batch, draw, settings.faults)
        mirrored = torch.rand(len(taken), generator=draw) < 0.5
        return Batch(
            *(
                _mirrored(getattr(batch, field.name), mirrored, normals=field.name in _NORMALS)
                for field in fields(batch)
            )
        )

    def _strips(self, settings: TrainingSettings, draw: torch.Generator) -> list[Arrays]:
        """Samples of full height."""
        width = min(settings.windows.strip_px, self._whole.width)
        left = _below(self._whole.width - width + 1, draw)
        window = Window(left, 0, width, self._whole.height)
        return [self._taken(_below(len(self), draw), window) for _ in range(settings.batch)]

    def _near(self, settings: TrainingSettings, draw: torch.Generator) -> list[Arrays]:
        """More samples, each around one of the subject's pixels, of as many pixels in all."""
        windows = settings.windows
        strip = min(windows.strip_px, self._whole.width) * self._whole.height
        count = round(settings.batch * strip / math.prod(windows.near_px))
        return [
            self._around(_below(len(self), draw), windows.wide_near, draw) for _ in range(count)
        ]

    def _around(self, index: int, size: tuple[int, int], draw: torch.Generator) -> Arrays:
        file, row = self._places[index]
        pixels = np.flatnonzero(file["mask"][row])
        middle = divmod(int(pixels[_below(len(pixels), draw)]), self._whole.width)
        top, left = (
            int(np.clip(at - side // 2, 0, most - side))
            for at, side, most in zip(
                middle, size[::-1], (self._whole.height, self._whole.width), strict=True
            )
        )
        return self._taken(index, Window(left, top, *size))

    def _taken(self, index: int, window: Window) -> Arrays:
        file, row = self._places[index]
        return {name: values[row][window.slices] for name, values in file.items() if name != "key"}


def _below(count: int, draw: torch.Generator) -> int:
    return int(torch.randint(count, (), generator=draw))


def read_samples(path: Path) -> Arrays:
    """The arrays of a file of training samples, and its key.

    Raises:
        DataError: not such a file.
    """
    return read_required_arrays(
        path, ("key", *_ARRAYS), "training samples", "Delete it, and it is made again"
    )


def _batch(taken: Sequence[Arrays]) -> Batch:
    maps = {
        name: _channels_first(torch.from_numpy(np.stack([arrays[name] for arrays in taken])))
        for name in _MAPS
    }
    mask = maps["mask"].float()
    normals = {name: maps[name].float() / _STEPS for name in _NORMALS}
    inside = {
        side: mask * (normals[side].abs().sum(1, keepdim=True) > 0) for side in ("front", "back")
    }
    return Batch(
        image=(maps["rgb"].float() / 127.5 - 1.0) * mask,
        mask=mask,
        **normals,
        front_inside=inside["front"],
        back_inside=inside["back"],
    )


def _channels_first(rows: Tensor) -> Tensor:
    """(B, C, H, W) of (B, H, W) or (B, H, W, C), the memory as it is: channels last."""
    return (rows[..., None] if rows.ndim == 3 else rows).movedim(-1, 1)


def _relight(arrays: Arrays, draw: torch.Generator) -> None:
    """Put a sample's photo into another light."""
    mask = arrays["mask"]
    picture = np.zeros_like(arrays["rgb"])
    seed = _below(2**31, draw)
    picture[mask] = relit(
        *(arrays[name][mask] for name in ("albedo", "lights", "coverage")),
        np.random.default_rng(seed),
    )
    arrays["rgb"] = picture


def _trimmed(batch: Batch, rim_px: int) -> Batch:
    """The batch without its rim."""
    inner = slice(rim_px, -rim_px or None)
    return Batch(*(getattr(batch, field.name)[:, :, inner, inner] for field in fields(batch)))


def _recoloured(image: Tensor, mask: Tensor, draw: torch.Generator) -> Tensor:
    """Pictures under other light and in other colours: gains, an exponent, exchanged channels."""
    count = len(image)
    gain = torch.exp(_GAIN * torch.randn(count, 3, 1, 1, generator=draw))
    exponent = torch.exp(_EXPONENT * torch.randn(count, 1, 1, 1, generator=draw))
    order = torch.argsort(torch.rand(count, 3, generator=draw), dim=1)
    mixed = torch.stack([picture[rows] for picture, rows in zip(image, order, strict=True)])
    light = ((mixed + 1.0) / 2.0 * gain).clamp(1e-4, 1.0) ** exponent
    return (2.0 * light - 1.0) * mask


def _placed(batch: Batch, place: Placement) -> Batch:
    """The batch turned and enlarged."""
    # Light adds up where colours blend, beside the subject with black.
    light = (batch.image + batch.mask) / 2.0
    normals = [getattr(batch, name) for name in _NORMALS]
    light, mask, *normals = place.moved(
        [light, batch.mask, *normals], turning=[False, False, *[True] * len(normals)]
    )
    mask = (mask >= _COVERED).float()
    found = dict(zip(_NORMALS, normals, strict=True))
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
        other = other * torch.tensor([-1.0, 1.0, 1.0]).view(1, 3, 1, 1)
    return torch.where(chosen.view(-1, 1, 1, 1), other, values)
