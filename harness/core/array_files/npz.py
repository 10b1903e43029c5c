"""NPZ files of arrays: written atomically, and read after their headers have been checked."""

from __future__ import annotations

import math
import re
import struct
import zipfile
import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path

#: Largest total size of the wanted arrays of one file; those of SMPL-X take 230 MiB.
MOST_NPZ_BYTES = 768 * 2**20
#: Real arrays compress less than this; arrays of mostly zeros are small enough to be allowed.
_MOST_SHRINKAGE, _ALLOWANCE_BYTES = 16, 64 * 2**20
_MOST_DIRECTORY_BYTES = 2**20
_MOST_HEADER_BYTES, _MOST_DIMENSIONS = 10_000, 8
_END, _END_SIZE, _MOST_COMMENT = b"PK\x05\x06", 22, 65_535
_END_OF_LARGE, _END_OF_LARGE_SIZE = b"PK\x06\x07", 20
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 1
_HEADER = re.compile(
    r"\s*\{\s*'descr'\s*:\s*'(?P<kind>[<>=|]?(?:b1|[iu][1248]|f[248]|U\d{1,3}))'\s*,"
    r"\s*'fortran_order'\s*:\s*(?P<fortran>True|False)\s*,"
    r"\s*'shape'\s*:\s*\((?P<shape>[\dL,\s]{0,200})\)\s*,?\s*\}\s*"
)


@dataclass(frozen=True, slots=True)
class _Layout:
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    order: Literal["C", "F"]

    @property
    def size(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]], *, compressed: bool = True) -> None:
    """Write arrays by name as an NPZ file, atomically.

    Raises:
        DataError: a full disk or a missing right.
    """
    save = np.savez_compressed if compressed else np.savez
    with atomic_path(path) as temporary:
        save(temporary, **arrays)


def read_required_arrays(
    path: Path, names: Collection[str], content: str, hint: str
) -> dict[str, NDArray[Any]]:
    """The arrays of some names in an NPZ file, all of them; as ``read_array_npz``.

    Args:
        path: The file.
        names: Arrays that must be there.
        content: What the file ought to hold, for the message, such as ``fitted body``.
        hint: What to do about a file that holds something else, for the message.

    Raises:
        DataError: as ``read_array_npz``, or one of the arrays is not there.
    """
    try:
        found = read_array_npz(path, names)
    except DataError as error:
        raise DataError(
            f"{path} holds no {content}",
            expected=error.expected,
            got=error.got or error.what,
            hint=hint,
        ) from error
    if missing := [name for name in names if name not in found]:
        raise DataError(
            f"{path} holds no {content}",
            expected=", ".join(names),
            got=f"a file without {', '.join(missing)}",
            hint=hint,
        )
    return found


def read_array_npz(path: Path, wanted: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Some arrays of numbers or short text in an NPZ file, by name, read-only, of their own dtype.

    Memory stays below 16 times the file's size and 64 MiB, and never exceeds
    ``MOST_NPZ_BYTES`` by more than a few MiB.

    Args:
        path: The file, as ``numpy.savez`` or ``savez_compressed`` writes it.
        wanted: Arrays to return if they are there; everything else in the file is passed over.
            None is all arrays.

    Raises:
        DataError: no such file, not an NPZ, damaged or encrypted, or a wanted array of
            objects or records, that differs from its header, or that is larger than such a file can
            hold.
    """
    try:
        with path.open("rb") as stream:
            size = path.stat().st_size
            _check_directory(stream, size)
            with zipfile.ZipFile(stream) as archive:
                return _arrays(archive, wanted, _MOST_SHRINKAGE * size + _ALLOWANCE_BYTES)
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror or error}") from error
    except (
        ArithmeticError, EOFError, LookupError, NotImplementedError, RuntimeError, TypeError,
        ValueError, struct.error, zipfile.BadZipFile, zlib.error,
    ) as error:  # fmt: skip
        raise DataError(
            f"{path} was refused",
            expected="an NPZ file of numbers and short text",
            got=str(error) or type(error).__name__,
            hint="Get it again from where it is published",
        ) from error


def _check_directory(stream: IO[bytes], size: int) -> None:
    """Refuse a table of contents that is larger than arrays need."""
    tail_size = min(size, _END_SIZE + _MOST_COMMENT + _END_OF_LARGE_SIZE)
    stream.seek(size - tail_size)
    tail = stream.read(tail_size)
    at = tail.rfind(_END)
    if at < 0 or len(tail) < at + _END_SIZE:
        raise ValueError("it is no zip file, or is cut off")
    directory_bytes = int(struct.unpack_from("<I", tail, at + 12)[0])
    if directory_bytes > _MOST_DIRECTORY_BYTES or _END_OF_LARGE in tail[: at + _END_SIZE]:
        raise ValueError("its list of contents is longer than any list of arrays")
    stream.seek(0)


def _arrays(
    archive: zipfile.ZipFile, wanted: Collection[str] | None, room: int
) -> dict[str, NDArray[Any]]:
    members = [
        info
        for info in archive.infolist()
        if wanted is None or info.filename.removesuffix(".npy") in wanted
    ]
    total = sum(info.file_size for info in members)
    if total > min(room, MOST_NPZ_BYTES):
        raise ValueError(f"its arrays would take {total} bytes, more than such a file can hold")
    return {info.filename.removesuffix(".npy"): _array(archive, info) for info in members}


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    if info.compress_type not in _METHODS or info.flag_bits & _ENCRYPTED:
        raise ValueError(f"'{info.filename}' is encrypted, or compressed in an unknown way")
    with archive.open(info) as stream:
        layout, header_size = _layout(stream, info.filename)
        if header_size + layout.size != info.file_size:
            raise ValueError(
                f"'{info.filename}' promises {layout.dtype} of shape {layout.shape} "
                f"in {info.file_size - header_size} bytes"
            )
        # One byte more than there is makes the archive compare its checksum.
        content = stream.read(layout.size + 1)
    if len(content) != layout.size:
        raise ValueError(f"'{info.filename}' is cut off")
    return np.frombuffer(content, layout.dtype).reshape(layout.shape, order=layout.order)


def _layout(stream: IO[bytes], name: str) -> tuple[_Layout, int]:
    """What an array's header says, and its size in bytes."""
    start = stream.read(8)
    form = {1: "<H", 2: "<I", 3: "<I"}.get(start[6]) if len(start) == 8 else None
    if not start.startswith(b"\x93NUMPY") or form is None:
        raise ValueError(f"'{name}' is no array of numpy's")
    length_bytes = struct.calcsize(form)
    length = int(struct.unpack(form, stream.read(length_bytes))[0])
    if length > _MOST_HEADER_BYTES:
        raise ValueError(f"'{name}' has a header of {length} bytes")
    found = _HEADER.fullmatch(stream.read(length).decode("latin1"))
    if found is None:
        raise ValueError(f"'{name}' holds something else than numbers or short text")
    sizes = [word.strip().removesuffix("L") for word in found["shape"].split(",")]
    shape = tuple(int(word) for word in sizes if word)
    if len(shape) > _MOST_DIMENSIONS:
        raise ValueError(f"'{name}' has {len(shape)} dimensions")
    order = "F" if found["fortran"] == "True" else "C"
    return _Layout(np.dtype(found["kind"]), shape, order), 8 + length_bytes + length
