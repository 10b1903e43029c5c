"""NPZ files of arrays: written atomically, and read after their headers have been checked."""

import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path

#: Largest total size of the wanted arrays of one file; those of SMPL-X take 230 MiB.
MOST_NPZ_BYTES = 768 * 2**20
#: Real arrays compress less than this; arrays of mostly zeros are small enough to be allowed.
_MOST_SHRINKAGE, _ALLOWANCE_BYTES = 16, 64 * 2**20
_MOST_ITEM_BYTES = 4000
_FORMAT: Any = np.lib.format
_HEADERS: Mapping[
    tuple[int, int], Callable[[IO[bytes]], tuple[tuple[int, ...], bool, np.dtype[Any]]]
] = {(1, 0): _FORMAT.read_array_header_1_0, (2, 0): _FORMAT.read_array_header_2_0}
# Arrays of Python 2, such as SMPL-X's own, are read like others.
warnings.filterwarnings("ignore", r"Reading `\.npy` or `\.npz` file required additional header")


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
    """Some arrays of numbers or short text in an NPZ file, by name, of their own dtype.

    They take at most 16 times the file's size and 64 MiB, and never more than ``MOST_NPZ_BYTES``.

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
        room = min(_MOST_SHRINKAGE * path.stat().st_size + _ALLOWANCE_BYTES, MOST_NPZ_BYTES)
        with zipfile.ZipFile(path) as archive:
            members = [
                info
                for info in archive.infolist()
                if wanted is None or info.filename.removesuffix(".npy") in wanted
            ]
            total = sum(info.file_size for info in members)
            if total > room:
                raise ValueError(f"its arrays take {total} bytes, more than such a file can hold")
            return {info.filename.removesuffix(".npy"): _array(archive, info) for info in members}
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror or error}") from error
    except (
        ArithmeticError, EOFError, LookupError, MemoryError, NotImplementedError, RuntimeError,
        SyntaxError, TypeError, ValueError, struct.error, tokenize.TokenError, zipfile.BadZipFile,
        zlib.error,
    ) as error:  # fmt: skip
        raise DataError(
            f"{path} was refused",
            expected="an NPZ file of numbers and short text",
            got=shown_text(str(error) or type(error).__name__, 200),
            hint="Get it again from where it is published",
        ) from error


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(info) as stream:
        shape, fortran, dtype = _HEADERS[_FORMAT.read_magic(stream)](stream)
        size = math.prod(shape) * dtype.itemsize
        if (
            dtype.kind not in "biufU"
            or dtype.itemsize > _MOST_ITEM_BYTES
            or min(shape, default=0) < 0
        ):
            raise ValueError(f"'{info.filename}' holds something else than numbers or short text")
        if stream.tell() + size != info.file_size:
            raise ValueError(f"'{info.filename}' has another size than its header promises")
        # One byte more than there is makes the archive compare its checksum.
        content = stream.read(size + 1)
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran else "C")


def shown_text(text: str, most: int = 60) -> str:
    """Untrusted text for a message, shortened and without terminal control characters."""
    return text[:most].encode("unicode_escape").decode()
