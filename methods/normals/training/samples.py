"""Training samples in memory, drawn in batches and varied as they are drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from harness.core.array_files.npz import read_required_arrays
from harness.core.errors import DataError
from methods.normals.training.photo_faults import spoilt
from methods.normals.training.settings import FaultShares, TrainingSettings
from methods.normals.training.turning import Placement, drawn_placement

__all__ = ["Batch", "Samples"]

_ARRAYS = ("rgb", "mask", "front", "back", "body_front", "body_back")
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
        arrays: By the names of ``harness.pipeline.training.samples.make_samples``.
        keys: Content ids of the files.
    """

    def __init__(self, arrays: dict[str, Tensor], keys: Sequence[str]) -> None:
        self._arrays = arrays
        self.keys = tuple(keys)

    @classmethod
    def load(cls, paths: Sequence[Path]) -> Samples:
        """The samples of some files, which must be of one size.

        Raises:
            DataError: a file that is not one of samples, or of another size than the first.
        """
        files = [_read(path) for path in paths]
        sizes = {file["rgb"].shape[1:] for file in files}
        if len(sizes) != 1:
            raise DataError(
                "training samples are of different sizes",
                expected="one size",
                got=", ".join(f"{size[1]} x {size[0]}" for size in sorted(sizes)),
            )
        arrays = {
            name: torch.from_numpy(np.concatenate([file[name] for file in files]))
            for name in _ARRAYS
        }
        return cls(arrays, [str(file["key"]) for file in files])

    def __len__(self) -> int:
        return len(self._arrays["rgb"])

    def at(self, indices: Iterable[int]) -> Batch:
        """The samples at some indices, as they are."""
        return self._batch(torch.as_tensor(list(indices)), slice(None))

    def drawn(self, settings: TrainingSettings, draw: torch.Generator) -> Batch:
        """Some samples with varied colours and a camera's faults, turned, half of them mirrored.

        Args:
            settings: Their number, how many of their columns are kept, and what varies how much.
            draw: Source of randomness.
        """
        count, width = settings.batch, settings.width_px
        rows = torch.randint(len(self), (count,), generator=draw)
        whole = self._arrays["mask"].shape[2]
        width = min(width, whole)
        left = int(torch.randint(whole - width + 1, (1,), generator=draw))
        batch = self._batch(rows, slice(left, left + width))
        batch = _placed(batch, drawn_placement(count, settings.turning, draw))
        batch = replace(batch, image=_recoloured(batch.image, batch.mask, draw))
        batch = _photographed(batch, draw, settings.faults)
        mirrored = torch.rand(count, generator=draw) < 0.5
        return Batch(
            *(
                _mirrored(getattr(batch, field.name), mirrored, normals=field.name in _NORMALS)
                for field in fields(batch)
            )
        )

    def _batch(self, rows: Tensor, columns: slice) -> Batch:
        taken = {name: _channels_first(self._arrays[name][rows][:, :, columns]) for name in _ARRAYS}
        mask = taken["mask"].float()
        normals = {name: taken[name].float() / _STEPS for name in _NORMALS}
        inside = {
            side: mask * (normals[side].abs().sum(1, keepdim=True) > 0)
            for side in ("front", "back")
        }
        return Batch(
            image=(taken["rgb"].float() / 127.5 - 1.0) * mask,
            mask=mask,
            **normals,
            front_inside=inside["front"],
            back_inside=inside["back"],
        )


def _read(path: Path) -> dict[str, np.ndarray]:
    return read_required_arrays(
        path, ("key", *_ARRAYS), "training samples", "Delete it, and it is made again"
    )


def _channels_first(rows: Tensor) -> Tensor:
    """(B, C, H, W) of (B, H, W) or (B, H, W, C), the memory as it is: channels last."""
    return (rows[..., None] if rows.ndim == 3 else rows).movedim(-1, 1)


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
