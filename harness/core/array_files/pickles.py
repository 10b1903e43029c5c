"""Numeric arrays from a pickle; nothing that it names is imported or called.

THuman's SMPL-X fits and SMPL-X's own ``.pkl`` are pickled dictionaries of arrays; some real fits
hold trimesh's ``TrackedArray``, which is an array with bookkeeping. An ordinary unpickler calls
any function that a file names, and numpy's own functions crash on crafted states. So arrays are
built here, from bytes of the length that their shape needs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from harness.core.array_files.pickle_machine import Refused, run_pickle
from harness.core.errors import DataError

#: The largest known file, SMPL-X as text, takes 520 MiB.
MOST_PICKLE_BYTES = 640 * 2**20
#: How much larger than the file its text and lists may become.
_ALLOWANCE_BYTES = 16 * 2**20
_MOST_DEPTH, _MOST_DIMENSIONS = 4, 8
_NUMERIC = re.compile(r"([<>=|]?)(\?|b1|[iu][1248]|f[248])")
_ARRAY_STATE = 5
_MOST_SHOWN = 60
_BYTE_ORDERS = ("<", ">", "=", "|")

#: The names that pickles of arrays refer to, and what they are called below.
_ROLES = {
    ("numpy", "ndarray"): "array",
    ("trimesh.caching", "TrackedArray"): "array",
    ("trimesh.base", "TrackedArray"): "array",
    ("numpy", "dtype"): "dtype",
    ("_codecs", "encode"): "encode",
    ("builtins", "bytes"): "bytes",
    ("__builtin__", "bytes"): "bytes",
    **{
        (f"{core}.{module}", name): role
        for core in ("numpy.core", "numpy._core")
        for module, name, role in (
            ("multiarray", "_reconstruct", "reconstruct"),
            ("multiarray", "scalar", "scalar"),
            ("numeric", "_frombuffer", "from buffer"),
        )
    },
}


@dataclass(frozen=True, slots=True)
class _Role:
    name: str


@dataclass(frozen=True, slots=True)
class _Foreign:
    """Stands for what is not rebuilt; ``what`` ends a sentence that begins with 'it'."""

    what: str


@dataclass(slots=True)
class _Kind:
    """A dtype; a pickle sets its byte order after creating it."""

    code: str
    order: str = ""

    def dtype(self) -> np.dtype[Any]:
        return np.dtype((self.order if self.order in "<>" else "") + self.code)


@dataclass(slots=True)
class _Pending:
    """An array; a pickle creates it empty and fills it later."""

    value: NDArray[Any] | _Foreign = _Foreign("holds an array without content")


def read_array_pickle(path: Path, wanted: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """The numeric arrays of a pickled dictionary, by name, read-only and of their own dtype.

    Memory stays below three times the file's size and 128 MiB.

    Args:
        path: The pickle, of any protocol, written by Python 2 or 3 and any numpy.
        wanted: Entries to return if they are there; everything else in the file is passed over.
            None: all of them, and anything beyond numbers in the file is refused.

    Raises:
        DataError: no such file, not a pickle, not a dictionary of numbers, or what is wanted is
            more than numeric arrays; nothing of that is executed.
    """
    try:
        size = path.stat().st_size
        if size > MOST_PICKLE_BYTES:
            raise DataError(
                f"{path} is larger than any pickle of arrays that is known",
                expected=f"at most {MOST_PICKLE_BYTES} bytes",
                got=str(size),
            )
        builder = _Builder(size + _ALLOWANCE_BYTES, strict=wanted is None)
        with path.open("rb") as stream:
            value = run_pickle(stream, size, builder)
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror}") from error
    except (ArithmeticError, LookupError, SyntaxError, TypeError, ValueError) as error:
        raise _refusal(path, str(error)) from error
    if not isinstance(value, dict):
        raise DataError(f"{path}", expected="a dictionary of arrays", got=type(value).__name__)
    entries = {str(name): entry for name, entry in cast("dict[object, object]", value).items()}
    return {
        name: _entry(path, name, entry, builder)
        for name, entry in entries.items()
        if wanted is None or name in wanted
    }


def _refusal(path: Path, got: str) -> DataError:
    return DataError(
        f"{path} was refused",
        expected="a pickled dictionary of numpy arrays and nothing else",
        got=got,
        hint="Do not load it by other means: a pickle can run any code",
    )


def _entry(path: Path, name: str, value: object, builder: _Builder) -> NDArray[Any]:
    found = value.value if isinstance(value, _Pending) else value
    if isinstance(found, _Foreign):
        raise _refusal(path, f"'{_shown(name)}': it {found.what}")
    try:
        return builder.numbers(found)
    except (OverflowError, TypeError, ValueError) as error:
        raise DataError(f"'{_shown(name)}' in {path} is not numeric", got=str(error)) from error


class _Builder:
    """Builds arrays from what the stack machine passes on.

    Args:
        room: Bytes that may be allocated beyond the size of the file.
        strict: Whether anything that is not an array is refused.
    """

    def __init__(self, room: int, *, strict: bool) -> None:
        self._room = room
        self._strict = strict

    def named(self, module: str, name: str) -> object:
        if (module, name) in _ROLES:
            return _Role(_ROLES[module, name])
        return self._foreign(f"refers to {_shown(module)}.{_shown(name)}")

    def called(self, function: object, arguments: object) -> object:
        if isinstance(function, _Foreign):
            return function
        if not isinstance(function, _Role) or not isinstance(arguments, tuple):
            raise Refused("it calls what is no function")
        given = cast("tuple[object, ...]", arguments)
        foreign = next((value for value in given if isinstance(value, _Foreign)), None)
        return foreign or self._made(function.name, given)

    def _made(self, role: str, given: tuple[object, ...]) -> object:
        made: object = None
        match (role, given):
            case ("reconstruct", (_Role("array"), *_)):
                made = _Pending()
            case ("dtype", (str() | bytes() as code, *_)):
                made = self._kind(_text(code))
            case ("encode", (str() as text, "latin1" | b"latin1")):
                self._spend(len(text))
                made = text.encode("latin1")
            case ("bytes", ()):
                made = b""
            case ("scalar", (_Kind() as kind, bytes() as content)):
                made = _array(content, kind, (), "C")
            case ("from buffer", (bytes() as content, _Kind() as kind, shape, order)):
                made = _array(content, kind, shape, order)
            case _:
                made = self._foreign(f"asks for another {role} than arrays need")
        return made

    def given(self, target: object, state: object) -> object:
        if isinstance(target, _Foreign):
            return target
        values = cast("tuple[object, ...]", state) if isinstance(state, tuple) else ()
        if isinstance(target, _Kind):
            self._set_kind(target, values)
        elif isinstance(target, _Pending):
            # A tracked array's own notes come as a dictionary, or after numpy's five values.
            if not isinstance(state, dict):
                target.value = self._content(values[:_ARRAY_STATE])
        else:
            raise Refused("it sets the state of what has none")
        return target

    def numbers(self, value: object) -> NDArray[Any]:
        """An entry as an array: an array itself, a number, or lists of numbers."""
        if isinstance(value, np.ndarray):
            return cast("NDArray[Any]", value)
        if isinstance(value, (list, tuple)):
            self._count(cast("list[object]", value), 1)
        elif not isinstance(value, (bool, int, float)):
            raise TypeError(type(value).__name__)
        made: NDArray[Any] = np.array(cast("object", value))
        if made.dtype.kind not in "biuf":
            raise TypeError("numbers too large for an array")
        return made

    def _count(self, values: list[object] | tuple[object, ...], depth: int) -> None:
        """Refuse lists of anything but numbers, and lists that become huge by sharing parts."""
        if depth > _MOST_DEPTH:
            raise ValueError(f"lists more than {_MOST_DEPTH} deep")
        self._spend(64 + 16 * len(values))
        for value in values:
            if isinstance(value, (list, tuple)):
                self._count(cast("list[object]", value), depth + 1)
            elif not isinstance(value, (bool, int, float)) and not _is_scalar(value):
                raise TypeError(f"a list that holds {type(value).__name__}")

    def _foreign(self, what: str) -> _Foreign:
        if self._strict:
            raise Refused(f"it {what}")
        return _Foreign(what)

    def _spend(self, count: int) -> None:
        self._room -= count
        if self._room < 0:
            raise Refused("it makes much more than it holds")

    def _kind(self, code: str) -> object:
        found = _NUMERIC.fullmatch(code)
        if found is None:
            return self._foreign(f"holds an array of '{_shown(code)}', which are not plain numbers")
        return _Kind(found[2], found[1])

    def _set_kind(self, kind: _Kind, state: tuple[object, ...]) -> None:
        match state:
            case (int(), str() | bytes() as order, *others) if _text(order) in _BYTE_ORDERS:
                if any(other is not None for other in others[:3]):
                    raise Refused("it holds a structured array")
                kind.order = _text(order)
            case _:
                raise Refused("it describes a kind of number in an unknown way")

    def _content(self, state: tuple[object, ...]) -> NDArray[Any] | _Foreign:
        match state:
            case (int(), shape, _Kind() as kind, fortran, bytes() as content):
                return _array(content, kind, shape, "F" if fortran else "C")
            case (int(), _, _Foreign() as foreign, *_):
                return foreign
            case _:
                return self._foreign("fills an array in an unknown way")


def _array(content: bytes, kind: _Kind, shape: object, order: object) -> NDArray[Any]:
    sizes = cast("tuple[object, ...]", shape) if isinstance(shape, tuple) else (None,)
    dimensions = [size for size in sizes if isinstance(size, int) and 0 <= size < 2**40]
    if len(dimensions) != len(sizes) or len(sizes) > _MOST_DIMENSIONS:
        raise Refused("it holds an array of an impossible shape")
    dtype = kind.dtype()
    if math.prod(dimensions) * dtype.itemsize != len(content):
        raise Refused(
            f"it holds an array of shape {tuple(dimensions)} and {dtype} in {len(content)} bytes"
        )
    if not isinstance(order, (str, bytes)) or _text(order) not in ("C", "F"):
        raise Refused("it holds an array in an unknown order")
    memory_order = "F" if _text(order) == "F" else "C"
    return np.frombuffer(content, dtype).reshape(dimensions, order=memory_order)


def _is_scalar(value: object) -> bool:
    return isinstance(value, np.ndarray) and np.ndim(cast("NDArray[Any]", value)) == 0


def _shown(text: str) -> str:
    """Untrusted text, shortened and without terminal control characters."""
    return text[:_MOST_SHOWN].encode("unicode_escape").decode()


def _text(value: str | bytes) -> str:
    return value if isinstance(value, str) else value.decode("latin1")
