"""Files of tensors without code in them: a list of names, then the numbers one after the other.

The form is that of the ``safetensors`` package: eight bytes with the length of a JSON header, the
header with dtype, shape and place of each tensor, and the memory.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path

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
