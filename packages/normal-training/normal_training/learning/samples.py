"""Training samples in memory, and batches of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from harness.core.errors import DataError
from harness.core.files.npz import read_required_arrays
from harness.geometry.window import Window

Arrays = dict[str, np.ndarray]
"""Of one subject, or of a window of one of its samples."""

NORMALS = ("body_front", "body_back", "front", "back")
"""The parts of a ``Batch`` that are normals."""

_MAPS = ("rgb", "mask", "front", "back", "body_front", "body_back")
_ARRAYS = (*_MAPS, "albedo", "lights", "coverage")
_STEPS = 127.0


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
        files: Arrays by the names of ``normal_training.sampling.samples.make_samples``, of one
            size, for each subject.
        keys: Content ids of the files.

    Attributes:
        whole: The window that shows all of a sample.
    """

    def __init__(self, files: Sequence[Arrays], keys: Sequence[str]) -> None:
        # Each file's arrays as they are: together they are many gigabytes, and twice that in one.
        self._places = [(file, row) for file in files for row in range(len(file["rgb"]))]
        height, width = files[0]["rgb"].shape[1:3]
        self.whole = Window.whole((width, height))
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
        return batch_of(stacked([self.taken(index, self.whole) for index in indices]))

    def mask(self, index: int) -> NDArray[np.bool_]:
        """(H, W) the mask of a sample."""
        file, row = self._places[index]
        return file["mask"][row]

    def taken(self, index: int, window: Window) -> Arrays:
        """What a window shows of a sample, by name; views of the arrays in memory."""
        file, row = self._places[index]
        return {name: values[row][window.slices] for name, values in file.items() if name != "key"}


def read_samples(path: Path) -> Arrays:
    """The arrays of a file of training samples, and its key.

    Raises:
        DataError: not such a file.
    """
    return read_required_arrays(
        path, ("key", *_ARRAYS), "training samples", "Delete it, and it is made again"
    )


def stacked(taken: Sequence[Arrays]) -> dict[str, Tensor]:
    """What ``batch_of`` needs of some samples, each name's arrays in one."""
    return {name: torch.from_numpy(np.stack([arrays[name] for arrays in taken])) for name in _MAPS}


def batch_of(stack: Mapping[str, Tensor]) -> Batch:
    """Stacked samples as a batch, on their device."""
    maps = {name: _channels_first(values) for name, values in stack.items()}
    mask = maps["mask"].float()
    normals = {name: maps[name].float() / _STEPS for name in NORMALS}
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
