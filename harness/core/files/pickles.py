"""Numeric arrays from a pickle; nothing that it names is imported or called.

THuman's SMPL-X fits and SMPL-X's own ``.pkl`` are pickled dictionaries of arrays; some real fits
hold trimesh's ``TrackedArray``, which is an array with bookkeeping. They are read in a child
process with little memory and time. There, every name in a pickle becomes one of the classes below:
numpy's own functions crash on crafted states.
"""

from __future__ import annotations

import contextlib
import math
import pickle
import re
import resource
import sys
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.files.npz import read_array_npz, shown_text, write_npz
from harness.core.process.threads import StepReport
from harness.core.process.workers import WorkerDied, run_worker, worker_main

#: The largest known file, SMPL-X as text, takes 520 MiB.
MOST_PICKLE_BYTES = 640 * 2**20
#: The child may take this much, and some times the file's size.
_ALLOWANCE_BYTES, _MOST_GROWTH = 2**28, 4
_MOST_S = 120.0
_MOST_DEPTH, _MOST_DIMENSIONS = 4, 8
_NUMERIC = re.compile(r"[<>=|]?(\?|b1|[iu][1248]|f[248])")
_HINT = "Do not load it by other means: a pickle can run any code"


def read_array_pickle(path: Path, wanted: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """The numeric arrays of a pickled dictionary, by name, of their own dtype.

    Args:
        path: The pickle, of any protocol, written by Python 2 or 3 and any numpy.
        wanted: Entries to return if they are there; everything else in the file is passed over.
            None: all of them, and anything beyond numbers in the file is refused. An entry of a
            dictionary in the dictionary is ``outer/inner``, and is wanted by either name; the
            entry of a file that is one array or number has no name.

    Raises:
        DataError: no such file, not a pickle, not a dictionary of numbers, what is wanted is more
            than numeric arrays, or it takes much more memory or time than arrays need; nothing of
            that is executed.
    """
    with contextlib.suppress(OSError):
        if path.stat().st_size > MOST_PICKLE_BYTES:
            raise DataError(
                f"{path} is larger than any pickle of arrays that is known",
                expected=f"at most {MOST_PICKLE_BYTES} bytes",
                got=str(path.stat().st_size),
            )
    with tempfile.TemporaryDirectory(prefix="harness-pickle-") as folder:
        arrays = Path(folder) / "arrays.npz"
        names = None if wanted is None else list(wanted)
        job = {"path": str(path), "wanted": names, "arrays": str(arrays)}
        try:
            # Threads of numpy's take memory of their own, and the child has little.
            one_thread = {"OPENBLAS_NUM_THREADS": "1"}
            result = run_worker(__name__, job, timeout_s=_MOST_S, environment=one_thread)
        except WorkerDied as error:
            raise _refusal(path, error.what) from error
        found = read_array_npz(arrays)
    return {name: found[str(index)] for index, name in enumerate(result["names"])}


def _read_in_child(job: dict[str, Any], _progress: StepReport) -> dict[str, object]:
    path = Path(job["path"])
    size = path.stat().st_size if path.is_file() else 0
    _limit_memory(_MOST_GROWTH * size + _ALLOWANCE_BYTES)
    found = arrays_of(path, job["wanted"])
    if sum(array.nbytes for array in found.values()) > size + _ALLOWANCE_BYTES:
        raise _refusal(path, "much more than the file holds")
    write_npz(
        Path(job["arrays"]),
        {str(index): array for index, array in enumerate(found.values())},
        compressed=False,
    )
    return {"names": list(found)}


def _limit_memory(more_bytes: int) -> None:
    """Let this process have so much more than it has."""
    if sys.platform != "linux":
        return
    most = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    most += more_bytes
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))


def arrays_of(path: Path, wanted: Collection[str] | None) -> dict[str, NDArray[Any]]:
    """As ``read_array_pickle``, in this process: a crafted file may take all its memory.

    Raises:
        DataError: as there.
    """
    try:
        with path.open("rb") as stream:
            value = _Arrays(stream, strict=wanted is None).load()
            room = iter(range(stream.tell() + 2**20))
        if isinstance(value, (_Array, float, int)):
            value = {"": value}
        if not isinstance(value, dict):
            raise DataError(f"{path}", expected="a dictionary of arrays", got=type(value).__name__)
        return {
            name: _numbers(path, name, entry, room)
            for name, entry in _entries(cast("object", value), room)
            if wanted is None or name in wanted or name.rpartition("/")[2] in wanted
        }
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror}") from error
    except MemoryError as error:
        raise _refusal(path, "more memory than arrays need") from error
    except (
        ArithmeticError, AttributeError, EOFError, LookupError, RecursionError, SyntaxError,
        TypeError, ValueError, pickle.UnpicklingError,
    ) as error:  # fmt: skip
        raise _refusal(path, str(error)) from error


def _entries(value: object, room: Iterator[int], above: str = "") -> Iterator[tuple[str, object]]:
    """Names and values of a dictionary; those of a dictionary in it as ``outer/inner``."""
    for key, entry in cast("dict[object, object]", value).items():
        name = f"{above}{key}"
        if next(room, None) is None or name.count("/") > _MOST_DEPTH:
            raise ValueError("dictionaries that are deeper, or hold more, than the file")
        if isinstance(entry, dict):
            yield from _entries(cast("object", entry), room, f"{name}/")
        else:
            yield name, entry


def _refusal(path: Path, got: str) -> DataError:
    return DataError(
        f"{path} was refused",
        expected="a pickled dictionary of numpy arrays and nothing else",
        got=shown_text(got, 200),
        hint=_HINT,
    )


def _numbers(path: Path, name: str, entry: object, room: Iterator[int]) -> NDArray[Any]:
    if isinstance(entry, _Ignored):
        raise _refusal(path, f"'{shown_text(name)}': it {entry.what}")
    if isinstance(entry, _Array):
        try:
            return entry.value
        except (AttributeError, TypeError, ValueError) as error:
            raise _refusal(path, f"'{shown_text(name)}': {error}") from error
    try:
        made = np.array(_plain(entry, room, 0))
        if made.dtype.kind not in "biuf":
            raise TypeError("numbers too large for an array")
    except (OverflowError, TypeError, ValueError) as error:
        raise DataError(f"'{shown_text(name)}' in {path} is not numeric", got=str(error)) from error
    return made


def _plain(value: object, room: Iterator[int], depth: int) -> object:
    """Numbers and lists of numbers; lists become huge by sharing parts."""
    if next(room, None) is None or depth > _MOST_DEPTH:
        raise ValueError("lists that are deeper, or hold more, than the file")
    if isinstance(value, (list, tuple)):
        return [_plain(each, room, depth + 1) for each in cast("list[object]", value)]
    if isinstance(value, _Array) and value.value.ndim == 0:
        return value.value
    if not isinstance(value, (bool, int, float)):
        raise TypeError(type(value).__name__)
    return value


class _Ignored:
    """Stands for anything that a pickle names and that is not rebuilt, called or filled."""

    what = "holds something else"

    def __new__(cls, *_: object, **__: object) -> _Ignored:
        return object.__new__(cls)

    def __call__(self, *_: object, **__: object) -> _Ignored:
        """Stand for what the call of a method would give, too."""
        return self

    def __setstate__(self, state: object) -> None:
        pass

    def __setitem__(self, key: object, value: object) -> None:
        pass

    def append(self, value: object) -> None:
        """Pass over what a pickle adds."""


class _Kind:
    """A dtype; a pickle sets its byte order after creating it."""

    def __init__(self, code: str | bytes, *_: object) -> None:
        self.code, self.order = _text(code), ""

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        if any(each is not None for each in state[2:5]):
            raise ValueError("it holds a structured array")
        self.order = _text(state[1])

    @property
    def dtype(self) -> np.dtype[Any]:
        found = _NUMERIC.fullmatch(self.code)
        if found is None:
            raise TypeError(
                f"it holds an array of '{shown_text(self.code)}', which are not plain numbers"
            )
        return np.dtype((self.order if self.order in "<>" else "") + found[1])


class _Array:
    """An array; a pickle creates it empty and fills it later.

    Those of kinds that are not numbers stay unread, unless they are wanted.
    """

    def __init__(self, *state: Any) -> None:
        self.state = state

    def __setstate__(self, state: object) -> None:
        # A tracked array's own notes come as a dictionary, or after numpy's five values.
        if isinstance(state, tuple):
            _, shape, kind, fortran, content = cast("tuple[Any, ...]", state)[:5]
            self.state = (content, kind, shape, "F" if fortran else "C")

    @property
    def value(self) -> NDArray[Any]:
        if len(self.state) != 4:
            raise ValueError("it holds an array without content")
        content, kind, shape, order = self.state
        dtype, content = cast("_Kind", kind).dtype, _bytes(content)
        if len(shape) > _MOST_DIMENSIONS or not all(type(size) is int for size in shape):
            raise ValueError("it holds an array of an impossible shape")
        if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(content):
            raise ValueError(
                f"it holds an array of shape {shape} and {dtype} in {len(content)} bytes"
            )
        return np.frombuffer(content, dtype).reshape(shape, order=_text(order))  # type: ignore[call-overload]


def _bytes(text: str | bytes, _encoding: object = None) -> bytes:
    """What Python 2, or a protocol without bytes, writes as text."""
    return text.encode("latin1") if isinstance(text, str) else text


def _empty(*_: object) -> _Array:
    return _Array()


def _scalar(kind: _Kind, content: str | bytes = b"") -> _Array:
    return _Array(content, kind, (), "C")


#: The names that pickles of arrays refer to, and what they become.
_NAMES: dict[tuple[str, str], object] = {
    ("numpy", "ndarray"): _Array,
    ("trimesh.caching", "TrackedArray"): _Array,
    ("trimesh.base", "TrackedArray"): _Array,
    ("numpy", "dtype"): _Kind,
    ("_codecs", "encode"): _bytes,
    ("builtins", "bytes"): bytes,
    ("__builtin__", "bytes"): bytes,
}
for _core in ("numpy.core", "numpy._core"):
    _NAMES[f"{_core}.multiarray", "_reconstruct"] = _empty
    _NAMES[f"{_core}.multiarray", "scalar"] = _scalar
    _NAMES[f"{_core}.numeric", "_frombuffer"] = _Array


class _Arrays(pickle.Unpickler):
    """Reads a pickle whose every name becomes a class of this module.

    Args:
        stream: The pickle.
        strict: Whether a name that arrays do not need is refused.
    """

    def __init__(self, stream: IO[bytes], *, strict: bool) -> None:
        # Python 2 writes bytes as text.
        super().__init__(stream, encoding="latin1")
        self._strict = strict

    def find_class(self, module_name: str, global_name: str, /) -> Any:
        known = _NAMES.get((module_name, global_name))
        if known is None:
            what = f"refers to {shown_text(f'{module_name}.{global_name}')}"
            if self._strict:
                raise pickle.UnpicklingError(f"it {what}")
            return type("_Ignored", (_Ignored,), {"what": what})
        return known


def _text(value: str | bytes) -> str:
    return value if isinstance(value, str) else value.decode("latin1")


if __name__ == "__main__":
    worker_main(_read_in_child)
