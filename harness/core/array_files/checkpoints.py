"""Tensors from a file of ``torch.save``; nothing that it names is imported or called.

Such a file is a zip archive: ``<root>/data.pkl`` is the list of tensors, and ``<root>/data/<n>`` is
the memory of each. PyTorch is not needed.
"""

from __future__ import annotations

import contextlib
import io
import struct
import zipfile
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from harness.core.array_files.pickle_machine import Refused
from harness.core.array_files.tensor_list import STORAGES, StoredTensor, read_tensor_list
from harness.core.errors import DataError
from harness.core.files.names import is_name

#: PIXIE's, the longest list of tensors that is known, takes half a MiB.
_MOST_PICKLE_BYTES = 8 * 2**20
_MOST_DIRECTORY_BYTES = 4 * 2**20
_END_SIZE, _LOCATOR_SIZE, _LARGE_END_SIZE = 22, 20, 56
_ENCRYPTED = 1
#: How files of PyTorch before 1.6 begin, behind the protocol: a pickled number.
_LEGACY = b"\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19"
_CONVERT = (
    "Convert it: python -c \"import torch; torch.save(torch.load('{name}', map_location='cpu', "
    "weights_only=True), 'converted.ckpt')\""
)
_GET_AGAIN = "Get it again from where it is published"


class Checkpoint:
    """What a file of ``torch.save`` holds; only its list of tensors is read at first.

    Args:
        path: The file.

    Raises:
        DataError: no such file; no checkpoint, such as a web page or another archive; one of
            PyTorch before 1.6, with the command that converts it; or one that is cut off, damaged,
            or does more than tensors need.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        _refuse_other_files(path)
        with _explained(path), path.open("rb") as stream:
            _check_directory(stream)
            with zipfile.ZipFile(stream) as archive:
                self._root = _root(archive)
                program = _content(archive, f"{self._root}data.pkl", _MOST_PICKLE_BYTES)
                order = f"{self._root}byteorder"
                if order in archive.namelist() and _content(archive, order, 16) != b"little":
                    raise Refused("its numbers are written in another byte order")
            self._value = read_tensor_list(program)

    def has(self, *place: str) -> bool:
        """Whether there is a dictionary under some keys, one in the other."""
        return self._at(place) is not None

    def tensors(self, *place: str) -> dict[str, StoredTensor]:
        """The tensors of the dictionary under some keys, by name; nothing else that is in it.

        Raises:
            DataError: there is no such dictionary.
        """
        found = self._at(place)
        if found is None:
            raise DataError(
                f"{self.path} is another checkpoint than it should be",
                expected=f"a dictionary under {'.'.join(place)}" if place else "a dictionary",
                got=self._top(),
                hint=_GET_AGAIN,
            )
        return {str(k): value for k, value in found.items() if isinstance(value, StoredTensor)}

    def read(self, tensors: Mapping[str, StoredTensor]) -> dict[str, NDArray[Any]]:
        """The numbers of some tensors, by name: float32, or whole numbers as they are.

        Raises:
            DataError: their memory is damaged, or is not what the list of tensors says.
        """
        with _explained(self.path), zipfile.ZipFile(self.path) as archive:
            return {name: self._numbers(archive, name, each) for name, each in tensors.items()}

    def _at(self, place: tuple[str, ...]) -> dict[object, object] | None:
        found: object = self._value
        for key in (*place, None):
            if not isinstance(found, dict):
                return None
            entries = cast("dict[object, object]", found)
            if key is None:
                return entries
            found = entries.get(key)
        return None

    def _top(self) -> str:
        """What lies at the top, for messages."""
        entries = self._at(())
        if entries is None:
            return f"a {type(self._value).__name__}"
        names = [_shown(str(key), 40) for key in entries]
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        return f"{', '.join(names[:5])}{more}" or "an empty one"

    def _numbers(self, archive: zipfile.ZipFile, name: str, tensor: StoredTensor) -> NDArray[Any]:
        dtype = np.dtype(STORAGES[tensor.storage])
        if not tensor.fits:
            raise Refused(f"the tensor '{_shown(name)}' reaches beyond its memory")
        size = tensor.count * dtype.itemsize
        content = _content(archive, f"{self._root}data/{tensor.member}", size)
        if len(content) != size:
            raise Refused(f"the memory of '{_shown(name)}' has {len(content)} bytes, not {size}")
        view = np.lib.stride_tricks.as_strided(
            np.frombuffer(content, dtype)[tensor.offset :],
            tensor.shape,
            [stride * dtype.itemsize for stride in tensor.strides],
            writeable=False,
        )
        if tensor.storage == "BFloat16Storage":
            return (view.astype(np.uint32) << 16).view(np.float32)
        return view.astype(np.float32 if dtype.kind == "f" else dtype)


def _root(archive: zipfile.ZipFile) -> str:
    """The folder of the archive in which everything is, with its slash."""
    lists = [name for name in archive.namelist() if name.endswith("/data.pkl")]
    if len(lists) != 1:
        raise Refused("a zip archive without a list of tensors; unpack it and name the file in it")
    return lists[0].removesuffix("data.pkl")


def _content(archive: zipfile.ZipFile, name: str, most_bytes: int) -> bytes:
    info = archive.getinfo(name)
    if info.compress_type != zipfile.ZIP_STORED or info.flag_bits & _ENCRYPTED:
        raise Refused(f"'{_shown(name)}' is compressed or encrypted, which PyTorch never does")
    if info.file_size > most_bytes:
        raise Refused(f"'{_shown(name)}' takes {info.file_size} bytes, at most {most_bytes}")
    if info.compress_size != info.file_size:
        # Reading to the end takes as much memory at once as the stored size promises, up to 1 GiB.
        raise Refused(f"'{_shown(name)}' has two sizes, {info.compress_size} and {info.file_size}")
    with archive.open(info) as stream:
        # Reading to the end compares the checksum.
        return stream.read()


def _check_directory(stream: IO[bytes]) -> None:
    """Refuse a table of contents that is cut off, or longer than tensors need.

    PyTorch writes the form for large archives, which has its own record before the usual one.
    """
    size = stream.seek(0, io.SEEK_END)
    tail_size = min(size, _END_SIZE + _LOCATOR_SIZE + _LARGE_END_SIZE)
    stream.seek(size - tail_size)
    tail = stream.read(tail_size)
    if len(tail) < _END_SIZE or not tail[-_END_SIZE:].startswith(b"PK\x05\x06"):
        raise Refused(f"it is cut off after {size} bytes")
    directory_bytes = int(struct.unpack_from("<I", tail, len(tail) - _END_SIZE + 12)[0])
    if len(tail) > _LARGE_END_SIZE and tail.startswith(b"PK\x06\x06"):
        directory_bytes = int(struct.unpack_from("<Q", tail, 40)[0])
    if directory_bytes > _MOST_DIRECTORY_BYTES:
        raise Refused("its list of contents is longer than any list of tensors")
    stream.seek(0)


def _refuse_other_files(path: Path) -> None:
    """Name what is no checkpoint, by how it begins."""
    try:
        with path.open("rb") as stream:
            begin = stream.read(512)
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror or error}") from error
    if begin.startswith(b"PK\x03\x04"):
        return
    if not begin:
        raise DataError(f"{path} is empty", hint=_GET_AGAIN)
    if begin[2:].startswith(_LEGACY):
        name = path.name if is_name(path.name) else "FILE"
        raise DataError(
            f"{path} has the form of PyTorch before 1.6, which is not read",
            hint=_CONVERT.format(name=name),
        )
    if begin.lstrip()[:1] == b"<":
        raise DataError(
            f"{path} is a web page and no checkpoint",
            hint="The download wanted a login: get the file again while logged in",
        )
    got = "a tar archive" if begin[257:262] == b"ustar" else f"a file that begins {begin[:8]!r}"
    raise DataError(
        f"{path} is no checkpoint", expected="a file of torch.save", got=got, hint=_GET_AGAIN
    )


@contextlib.contextmanager
def _explained(path: Path) -> Generator[None]:
    """Turn what a broken file causes into a ``DataError``."""
    try:
        yield
    except (
        ArithmeticError, EOFError, LookupError, NotImplementedError, OSError, RuntimeError,
        SyntaxError, TypeError, ValueError, struct.error, zipfile.BadZipFile,
    ) as error:  # fmt: skip
        raise DataError(
            f"{path} was refused",
            expected="a file of torch.save that holds tensors",
            got=_shown(str(error) or type(error).__name__, 200),
            hint=_GET_AGAIN,
        ) from error


def _shown(text: str, most: int = 60) -> str:
    """Untrusted text, shortened and without terminal control characters."""
    return text[:most].encode("unicode_escape").decode()
