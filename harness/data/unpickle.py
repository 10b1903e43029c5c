"""Pickles of numpy arrays, read without running what else they might hold.

THuman's SMPL-X fits are pickled dictionaries of arrays; some real ones hold trimesh's
``TrackedArray``, which is an array with bookkeeping. Anything else is refused, since a pickle can
call any function that it can name.
"""

from __future__ import annotations

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError

__all__ = ["read_array_pickle"]


def _latin1_bytes(text: str, encoding: str) -> bytes:
    """Stands in for ``_codecs.encode``, by which old pickles write the bytes of arrays."""
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"it encodes text as {encoding}")
    return text.encode("latin1")


def _numpy_names() -> dict[tuple[str, str], Any]:
    """What pickled arrays and scalars refer to, under the names of numpy 1 and 2."""
    names: dict[tuple[str, str], Any] = {
        ("numpy", "ndarray"): np.ndarray,
        ("numpy", "dtype"): np.dtype,
        ("_codecs", "encode"): _latin1_bytes,
    }
    for core in ("numpy.core", "numpy._core"):
        names[f"{core}.multiarray", "_reconstruct"] = np.core.multiarray._reconstruct  # noqa: SLF001
        names[f"{core}.multiarray", "scalar"] = np.core.multiarray.scalar
        names[f"{core}.numeric", "_frombuffer"] = np.core.numeric._frombuffer  # noqa: SLF001
    return names


_ALLOWED = _numpy_names()


class _TrackedArray(np.ndarray):
    """Reads trimesh's array, whose pickled state may carry one more item than numpy's."""

    def __setstate__(self, state: Any) -> None:
        if isinstance(state, dict):
            return
        super().__setstate__(state[:5])


class _ArrayUnpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in (
            ("trimesh.caching", "TrackedArray"),
            ("trimesh.base", "TrackedArray"),
        ):
            return _TrackedArray
        try:
            return _ALLOWED[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"it refers to {module}.{name}") from None


def read_array_pickle(path: Path) -> dict[str, NDArray[np.float64]]:
    """The numeric arrays of a pickled dictionary, as plain float64 arrays.

    Raises:
        DataError: no such file, not a pickle, not a dictionary of numbers, or anything beyond numpy
            arrays in it; nothing of that is executed.
    """
    try:
        # latin1: fits written by Python 2 hold their bytes as text.
        value = _ArrayUnpickler(io.BytesIO(path.read_bytes()), encoding="latin1").load()
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror}") from error
    # Broken pickles raise whatever their garbage leads to.
    except Exception as error:
        raise DataError(
            f"{path} was refused",
            expected="a pickled dictionary of numpy arrays and nothing else",
            got=str(error),
            hint="Do not load it by other means: a pickle can run any code",
        ) from error
    if not isinstance(value, dict):
        raise DataError(f"{path}", expected="a dictionary of arrays", got=type(value).__name__)
    arrays = {}
    for name, entry in value.items():
        try:
            arrays[str(name)] = np.array(entry, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise DataError(f"'{name}' in {path} is not numeric", got=str(error)) from error
    return arrays
