"""The tensors of a network in a checkpoint: all of them, of their shapes, and no others."""

from __future__ import annotations

import io
import math
import pickle
import zipfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.files.names import is_name
from harness.core.files.npz import shown_text
from harness.core.missing import not_installed

if TYPE_CHECKING:
    from torch import Tensor

_SHOWN = 3
#: No network that is known has a tensor of more than 10 million numbers.
_MOST_NUMBERS, _MOST_DIMENSIONS = 2**26, 8
#: How long the last record of a zip archive is.
_END_BYTES = 22
#: How files of PyTorch before 1.6 begin, behind the protocol: a pickled number.
_LEGACY = b"\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19"
_CONVERT = (
    "Convert it: python -c \"import torch; torch.save(torch.load('{name}', map_location='cpu', "
    "weights_only=True), 'converted.ckpt')\""
)
_GET_AGAIN = "Get it again from where it is published"


class Checkpoint:
    """What a file of ``torch.save`` holds; numbers are read when they are asked for.

    PyTorch rebuilds tensors and dictionaries; anything else that the file names becomes an object
    without meaning, and is not imported.

    Args:
        path: The file.

    Raises:
        MissingPart: PyTorch is not installed.
        DataError: no such file; no checkpoint, such as a web page or another archive; one of
            PyTorch before 1.6, with the command that converts it; or one that is cut off, damaged,
            or does more than tensors need.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        _refuse_other_files(path)
        try:
            self._value = _loaded(path)
        except (
            ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError,
            NotImplementedError, OSError, RuntimeError, TypeError, ValueError,
            pickle.UnpicklingError, zipfile.BadZipFile,
        ) as error:  # fmt: skip
            # What PyTorch says around it is how to run what the file holds.
            said = [part.strip() for part in str(error).split("\n\n")]
            reason = (said[-2] if len(said) > 2 else said[0]).partition("\n")[0]
            raise _refusal(path, reason or type(error).__name__) from error

    def has(self, *place: str) -> bool:
        """Whether there is a dictionary under some keys, one in the other."""
        return self._at(place) is not None

    def tensors(self, *place: str) -> dict[str, Tensor]:
        """The tensors of the dictionary under some keys, by name; nothing else that is in it.

        Raises:
            DataError: there is no such dictionary.
        """
        from torch import Tensor, strided

        found = self._at(place)
        if found is None:
            raise DataError(
                f"{self.path} is another checkpoint than it should be",
                expected=f"a dictionary under {'.'.join(place)}" if place else "a dictionary",
                got=self._top(),
                hint=_GET_AGAIN,
            )
        tensors = {str(k): value for k, value in found.items() if isinstance(value, Tensor)}
        return {
            name: each
            for name, each in tensors.items()
            if each.layout is strided and not (each.is_complex() or each.is_quantized)
        }

    def read(self, tensors: Mapping[str, Tensor]) -> dict[str, NDArray[Any]]:
        """The numbers of some tensors, by name: float32, or whole numbers as they are.

        Raises:
            DataError: a tensor is larger than any network's.
        """
        for name, tensor in tensors.items():
            if tensor.dim() > _MOST_DIMENSIONS or math.prod(tensor.shape) > _MOST_NUMBERS:
                raise DataError(
                    f"{self.path} was refused",
                    expected=f"tensors of at most {_MOST_NUMBERS} numbers",
                    got=f"'{shown_text(name)}' of shape {shown_text(str(tuple(tensor.shape)))}",
                )
        found = {name: tensor.detach() for name, tensor in tensors.items()}
        return {
            name: np.array(each.float() if each.is_floating_point() else each)
            for name, each in found.items()
        }

    def _at(self, place: tuple[str, ...]) -> dict[object, object] | None:
        found: object = self._value
        for key in place:
            found = (
                cast("dict[object, object]", found).get(key) if isinstance(found, dict) else None
            )
        return cast("dict[object, object]", found) if isinstance(found, dict) else None

    def _top(self) -> str:
        """What lies at the top, for messages."""
        entries = self._at(())
        if entries is None:
            return f"a {type(self._value).__name__}"
        names = [shown_text(str(key), 40) for key in entries]
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        return f"{', '.join(names[:5])}{more}" or "an empty one"


class _Ignored:
    """Stands for what a checkpoint holds besides tensors, such as the state of its training."""

    def __init__(self, *_: object) -> None:
        pass

    def __setstate__(self, state: object) -> None:
        pass


def _refusal(path: Path, got: str) -> DataError:
    return DataError(
        f"{path} was refused",
        expected="a file of torch.save that holds tensors",
        got=shown_text(got, 200),
        hint=_GET_AGAIN,
    )


def _loaded(path: Path) -> object:
    try:
        from torch import load, serialization
    except ImportError as error:
        raise not_installed("torch", "reading a checkpoint") from error
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        if sum(each.filename.endswith("/data.pkl") for each in members) != 1:
            raise ValueError(
                "a zip archive without a list of tensors; unpack it and name the file in it"
            )
        orders = [each for each in members if each.filename.endswith("/byteorder")]
        if any(each.file_size != 6 or archive.read(each) != b"little" for each in orders):
            raise ValueError("its numbers are written in another byte order")
        if any(each.compress_type != zipfile.ZIP_STORED for each in members):
            raise ValueError("it is compressed, which PyTorch never does")
        # PyTorch compares no checksums.
        if (damaged := archive.testzip()) is not None:
            raise ValueError(f"'{damaged}' is damaged: its CRC-32 is another")
    others = serialization.get_unsafe_globals_in_checkpoint(str(path))
    with serialization.safe_globals([(_Ignored, name) for name in others]):
        # Without mmap, which takes a tensor whose memory is too short from the rest of the file.
        return load(path, map_location="cpu", weights_only=True)


def _refuse_other_files(path: Path) -> None:
    """Name what is no checkpoint, by how it begins."""
    try:
        with path.open("rb") as stream:
            begin = stream.read(512)
            size = stream.seek(0, io.SEEK_END)
            stream.seek(max(size - _END_BYTES, 0))
            end = stream.read()
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror or error}") from error
    if begin.startswith(b"PK\x03\x04"):
        if not end.startswith(b"PK\x05\x06"):
            raise _refusal(path, f"it is cut off after {size} bytes")
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


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a dictionary of a checkpoint has to hold.

    Attributes:
        what: What the tensors are, for messages.
        shapes: Shape of each tensor by its name.
        own: What the names of a network's tensors begin with. Another tensor whose name begins so
            shows that the network is another one; names that begin otherwise do not matter.
        ignored: What names under ``own`` may also begin with, or end with.
    """

    what: str
    shapes: Mapping[str, tuple[int, ...]]
    own: str = ""
    ignored: tuple[str, ...] = ()

    def is_foreign(self, name: str) -> bool:
        """Whether a tensor cannot be in such a network."""
        if name in self.shapes or not name.startswith(self.own):
            return False
        return not (name.startswith(self.ignored) or name.endswith(self.ignored))


def read_wanted(
    checkpoint: Checkpoint, place: tuple[str, ...], wanted: Wanted
) -> dict[str, NDArray[np.float32]]:
    """A network's numbers by name, of the shapes that are wanted.

    Args:
        checkpoint: The file.
        place: Keys under which the dictionary lies, one in the other.
        wanted: What it has to hold.

    Raises:
        DataError: a tensor is missing, of another shape or kind, not finite, or of another network;
            or as ``Checkpoint.tensors`` and ``Checkpoint.read``.
    """
    there = checkpoint.tensors(*place)
    _refuse_others(checkpoint, wanted, there)
    for name, shape in wanted.shapes.items():
        if there[name].shape != shape:
            raise DataError(
                f"{checkpoint.path} does not hold {wanted.what}: {name} has another shape",
                expected=str(shape),
                got=str(tuple(there[name].shape)),
            )
    numbers = checkpoint.read({name: there[name] for name in wanted.shapes})
    return {name: _sound(checkpoint, name, array) for name, array in numbers.items()}


def _refuse_others(checkpoint: Checkpoint, wanted: Wanted, there: Mapping[str, Any]) -> None:
    missing = [name for name in wanted.shapes if name not in there]
    foreign = [name for name in there if wanted.is_foreign(name)]
    if missing:
        raise DataError(
            f"{checkpoint.path} does not hold {wanted.what}",
            expected=f"{len(wanted.shapes)} tensors",
            got=f"none called {_listed(missing)}",
        )
    if foreign:
        raise DataError(
            f"{checkpoint.path} does not hold {wanted.what} but a larger network",
            expected=f"{len(wanted.shapes)} tensors",
            got=f"also {_listed(foreign)}",
        )


def _listed(names: Collection[str]) -> str:
    shown = [shown_text(name, 80) for name in list(names)[:_SHOWN]]
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{', '.join(shown)}{more}"


def _sound(checkpoint: Checkpoint, name: str, array: NDArray[Any]) -> NDArray[np.float32]:
    if array.dtype != np.float32:
        raise DataError(
            f"{checkpoint.path}: {name} holds whole numbers", expected="real ones",
            got=str(array.dtype),
        )  # fmt: skip
    if not np.isfinite(array).all():
        raise DataError(f"{checkpoint.path} is damaged: {name} holds numbers that are not finite")
    return array
