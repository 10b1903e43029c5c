"""VGGT's weights as they are published, checked and reduced to what depth and cameras need.

The file is ``model.pt`` of PyTorch or ``model.safetensors``; nothing in it is run. What is written
is a file of tensors without code, 8 % smaller than the original, which any later run maps into
memory instead of copying it.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path
from harness.core.missing import not_installed

_MOST_HEADER_BYTES = 100 * 2**20
_SIZES = {"F32": 4, "F16": 2, "BF16": 2}


@dataclass(frozen=True, slots=True)
class TensorPlace:
    """A tensor in a file.

    Attributes:
        kind: ``F32``, ``F16`` or ``BF16``.
        shape: Its shape.
        start: First byte in the file.
    """

    kind: str
    shape: tuple[int, ...]
    start: int

    @property
    def bytes(self) -> int:
        """How many it takes."""
        return _SIZES[self.kind] * prod(self.shape)


def read_header(path: Path) -> dict[str, TensorPlace]:
    """Where each tensor of a file is, by name; no number is read.

    Raises:
        DataError: not such a file, cut off, or tensors that are not of real numbers.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            length = int.from_bytes(stream.read(8), "little")
            if not 2 <= length <= min(size - 8, _MOST_HEADER_BYTES):
                raise ValueError("its first eight bytes are not the length of a header")
            header: dict[str, Any] = json.loads(stream.read(length))
        header.pop("__metadata__", None)
        found = {name: _place(entry, 8 + length, size) for name, entry in header.items()}
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DataError(
            f"{path} is not a file of tensors",
            expected="safetensors with real numbers",
            got=str(error) or type(error).__name__,
            hint="Get it again from where it is published",
        ) from error
    return found


def _place(entry: Any, base: int, size: int) -> TensorPlace:
    kind, shape = str(entry["dtype"]), tuple(int(n) for n in entry["shape"])
    start, end = (int(n) for n in entry["data_offsets"])
    if kind not in _SIZES:
        raise ValueError(f"a tensor of type {kind}")
    if min(shape, default=0) < 0 or start < 0 or end - start != _SIZES[kind] * prod(shape):
        raise ValueError("a tensor that does not fill its place")
    if base + end > size:
        raise ValueError(f"it is cut off after {size} bytes")
    return TensorPlace(kind, shape, base + start)


def read_tensor(path: Path, place: TensorPlace) -> NDArray[np.float32]:
    """One tensor in single precision."""
    count = prod(place.shape)
    kinds = {"F32": np.dtype("<f4"), "F16": np.dtype("<f2"), "BF16": np.dtype("<u2")}
    values = np.fromfile(path, kinds[place.kind], count, offset=place.start)
    if place.kind == "BF16":
        values = (values.astype(np.uint32) << 16).view(np.float32)
    return values.astype(np.float32, copy=False).reshape(place.shape)


def write_tensors(
    path: Path,
    shapes: Mapping[str, tuple[int, ...]],
    values: Iterable[tuple[str, NDArray[np.float32]]],
) -> None:
    """Write tensors in single precision, atomically, one at a time.

    Args:
        path: The file.
        shapes: Shape of each tensor by name, in the order in which ``values`` has them.
        values: Each tensor with its name.

    Raises:
        DataError: a full disk or a missing right.
    """
    offset, header = 0, {}
    for name, shape in shapes.items():
        end = offset + 4 * prod(shape)
        header[name] = {"dtype": "F32", "shape": list(shape), "data_offsets": [offset, end]}
        offset = end
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    names = iter(shapes)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(len(text).to_bytes(8, "little") + text)
        for name, value in values:
            assert name == next(names)
            assert value.shape == shapes[name]
            stream.write(np.ascontiguousarray(value, "<f4").tobytes())
        assert next(names, None) is None


Shape = tuple[int, ...]

#: What names of tensors begin with that a file may hold and that are left out.
UNUSED_HEADS = ("point_head.", "track_head.")

_WIDTH, _BLOCKS, _HEAD_WIDTH = 1024, 24, 64
_CAMERA_BLOCKS, _FEATURES = 4, 256
_DPT_WIDTHS = (256, 512, 1024, 1024)


@functools.cache
def vggt_shapes() -> Mapping[str, Shape]:
    """Shape of each tensor by its name in the file."""
    found: dict[str, Shape] = {}
    found |= {
        "aggregator.camera_token": (1, 2, 1, _WIDTH),
        "aggregator.register_token": (1, 2, 4, _WIDTH),
    }
    found |= _patch_embedding("aggregator.patch_embed")
    for kind in ("frame_blocks", "global_blocks"):
        for number in range(_BLOCKS):
            name = f"aggregator.{kind}.{number}"
            found |= _block(name, _WIDTH) | _norm(f"{name}.attn.q_norm", _HEAD_WIDTH)
            found |= _norm(f"{name}.attn.k_norm", _HEAD_WIDTH)
    return found | _camera_head("camera_head", 2 * _WIDTH) | _depth_head("depth_head", 2 * _WIDTH)


def _norm(name: str, width: int) -> dict[str, Shape]:
    return {f"{name}.weight": (width,), f"{name}.bias": (width,)}


def _layer(name: str, *shape: int) -> dict[str, Shape]:
    """A linear or convolutional layer with a bias."""
    return {f"{name}.weight": shape, f"{name}.bias": shape[:1]}


def _block(name: str, width: int) -> dict[str, Shape]:
    """A transformer block."""
    return {
        **_norm(f"{name}.norm1", width),
        **_layer(f"{name}.attn.qkv", 3 * width, width),
        **_layer(f"{name}.attn.proj", width, width),
        f"{name}.ls1.gamma": (width,),
        **_norm(f"{name}.norm2", width),
        **_layer(f"{name}.mlp.fc1", 4 * width, width),
        **_layer(f"{name}.mlp.fc2", width, 4 * width),
        f"{name}.ls2.gamma": (width,),
    }


def _patch_embedding(name: str) -> dict[str, Shape]:
    found: dict[str, Shape] = {
        f"{name}.cls_token": (1, 1, _WIDTH),
        f"{name}.pos_embed": (1, 1 + 37 * 37, _WIDTH),
        f"{name}.register_tokens": (1, 4, _WIDTH),
        f"{name}.mask_token": (1, _WIDTH),
        **_norm(f"{name}.norm", _WIDTH),
    }
    # A convolution's bias has one number for each output, as a linear layer's has.
    found |= _layer(f"{name}.patch_embed.proj", _WIDTH, 3, 14, 14)
    for number in range(_BLOCKS):
        found |= _block(f"{name}.blocks.{number}", _WIDTH)
    return found


def _camera_head(name: str, width: int) -> dict[str, Shape]:
    found: dict[str, Shape] = {
        f"{name}.empty_pose_tokens": (1, 1, 9),
        **_norm(f"{name}.token_norm", width),
        **_norm(f"{name}.trunk_norm", width),
        **_layer(f"{name}.embed_pose", width, 9),
        **_layer(f"{name}.poseLN_modulation.1", 3 * width, width),
        **_layer(f"{name}.pose_branch.fc1", width // 2, width),
        **_layer(f"{name}.pose_branch.fc2", 9, width // 2),
    }
    for number in range(_CAMERA_BLOCKS):
        found |= _block(f"{name}.trunk.{number}", width)
    return found


def _depth_head(name: str, width: int) -> dict[str, Shape]:
    found: dict[str, Shape] = _norm(f"{name}.norm", width)
    for number, own in enumerate(_DPT_WIDTHS):
        found |= _layer(f"{name}.projects.{number}", own, width, 1, 1)
        found[f"{name}.scratch.layer{number + 1}_rn.weight"] = (_FEATURES, own, 3, 3)
    for number, size in ((0, 4), (1, 2), (3, 3)):
        own = _DPT_WIDTHS[number]
        found |= _layer(f"{name}.resize_layers.{number}", own, own, size, size)
    for number in range(1, 5):
        part = f"{name}.scratch.refinenet{number}"
        found |= _layer(f"{part}.out_conv", _FEATURES, _FEATURES, 1, 1)
        # The innermost one has nothing to add to, so that its first unit is missing.
        for unit in ("resConfUnit1", "resConfUnit2")[number == 4 :]:
            for conv in ("conv1", "conv2"):
                found |= _layer(f"{part}.{unit}.{conv}", _FEATURES, _FEATURES, 3, 3)
    found |= _layer(f"{name}.scratch.output_conv1", _FEATURES // 2, _FEATURES, 3, 3)
    found |= _layer(f"{name}.scratch.output_conv2.0", 32, _FEATURES // 2, 3, 3)
    found |= _layer(f"{name}.scratch.output_conv2.2", 2, 32, 1, 1)
    return found


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
