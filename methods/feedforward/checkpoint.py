"""VGGT's weights as they are published, checked and reduced to what depth and cameras need.

The file is ``model.pt`` of PyTorch or ``model.safetensors``; nothing in it is run. What is written
is a file of tensors without code, 8 % smaller than the original, which any later run maps into
memory instead of copying it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.missing import not_installed
from methods.feedforward.safetensors import read_header, read_tensor, write_tensors
from methods.feedforward.tensors import UNUSED_HEADS, vggt_shapes

#: The reduced file's name.
WEIGHTS_FILE = "vggt.safetensors"
#: Names of the file in a folder as it is published.
_NAMES = ("model.safetensors", "model.pt", "vggt_1B_commercial.pt")
_SHOWN = 3
_GET_AGAIN = "Get model.pt or model.safetensors of facebook/VGGT-1B from huggingface.co again"

Shapes = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class VggtWeights:
    """A file whose tensors are VGGT's.

    Attributes:
        path: The file.
        shapes: What is kept of it.
        dropped: How many tensors are left out.
        read: The tensor of a name.
    """

    path: Path
    shapes: Shapes
    dropped: int
    read: Callable[[str], NDArray[np.float32]]

    def write(self, folder: Path) -> None:
        """Write what is kept into a folder, as ``WEIGHTS_FILE``, atomically.

        Raises:
            DataError: numbers that are not finite, a full disk or a missing right.
        """
        write_tensors(folder / WEIGHTS_FILE, self.shapes, self._sound())

    def _sound(self) -> Iterator[tuple[str, NDArray[np.float32]]]:
        for name in self.shapes:
            value = self.read(name)
            if not np.isfinite(value).all():
                raise DataError(
                    f"{self.path} is damaged: {name} holds numbers that are not finite",
                    hint=_GET_AGAIN,
                )
            yield name, value


def weights_file(path: Path) -> Path:
    """The file of weights at a path, or in a folder as it is published.

    Raises:
        DataError: there is none.
    """
    if path.is_dir():
        for name in _NAMES:
            if (path / name).is_file():
                return path / name
        raise DataError(f"no weights in {path}", expected=" or ".join(_NAMES), hint=_GET_AGAIN)
    if not path.is_file():
        raise DataError(f"no file at {path}", hint=_GET_AGAIN)
    return path


def examined_weights(path: Path, wanted: Shapes | None = None) -> VggtWeights:
    """The weights at a path, if they are VGGT's; nothing is written.

    Args:
        path: A file, or a folder as it is published.
        wanted: What it has to hold; None is VGGT-1B.

    Raises:
        DataError: no such file, not tensors, or tensors that are missing, of another shape, or of
            another network.
        MissingPart: torch, which reads ``model.pt``, is not installed.
    """
    file, shapes = weights_file(path), wanted if wanted is not None else vggt_shapes()
    if file.suffix == ".safetensors":
        places = read_header(file)
        found = {name: place.shape for name, place in places.items()}

        def read(name: str) -> NDArray[np.float32]:
            return read_tensor(file, places[name])
    else:
        state = _state(file)
        found = {name: tuple(tensor.shape) for name, tensor in state.items()}

        def read(name: str) -> NDArray[np.float32]:
            return state[name].detach().float().contiguous().numpy()

    _require_vggt(file, found, shapes)
    return VggtWeights(file, shapes, len(found) - len(shapes), read)


def _require_vggt(path: Path, found: Shapes, wanted: Shapes) -> None:
    missing = [name for name in wanted if name not in found]
    foreign = [name for name in found if name not in wanted and not name.startswith(UNUSED_HEADS)]
    for what, names in (("lacks", missing), ("also holds", foreign)):
        if names:
            more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
            raise DataError(
                f"{path} is not of VGGT-1B",
                expected=f"{len(wanted)} tensors of aggregator, camera_head and depth_head",
                got=f"it {what} {', '.join(names[:_SHOWN])}{more}",
                hint=_GET_AGAIN,
            )
    for name, shape in wanted.items():
        if found[name] != shape:
            raise DataError(
                f"{path} is not of VGGT-1B: {name} has another shape",
                expected=str(shape),
                got=str(found[name]),
                hint=_GET_AGAIN,
            )


def _state(path: Path) -> dict[str, Any]:
    """The tensors of a file of ``torch.save`` by name; nothing that it names is run."""
    try:
        import torch
    except ImportError as error:
        raise not_installed("torch", f"reading {path}", "or take model.safetensors") from error
    try:
        # Mapped: only what is kept is read.
        state = torch.load(path, map_location="cpu", weights_only=True, mmap=True)
    except Exception as error:
        raise DataError(
            f"{path} is not a checkpoint of tensors",
            got=(str(error).strip().splitlines() or [type(error).__name__])[0][:200],
            hint=_GET_AGAIN,
        ) from error
    if not isinstance(state, dict) or not state:
        raise DataError(f"{path} is not a list of tensors", got=type(state).__name__)
    odd = [str(name) for name, value in state.items() if not isinstance(value, torch.Tensor)]
    if odd:
        raise DataError(
            f"{path} is not a list of tensors", got=f"something else under {odd[0][:80]}"
        )
    return state
