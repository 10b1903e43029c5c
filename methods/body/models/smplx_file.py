"""The user's SMPL-X model file, checked array by array before the package ``smplx`` sees it.

The package unpickles whatever file it is named, so it is never named the user's: it reads a copy
that holds the checked arrays and nothing else.
"""

import contextlib
import functools
import importlib.util
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError, MissingPart
from harness.core.files.npz import read_array_npz
from harness.core.files.pickles import read_array_pickle
from harness.core.missing import not_installed

_WHERE = (
    "Register at https://smpl-x.is.tue.mpg.de, unpack models_smplx_v1_1.zip and run: "
    "harness parts import smplx <folder>/SMPLX_NEUTRAL.npz"
)
_VERTICES, _FACES, _LANDMARKS = 10475, 20908, 51
JOINTS, BETAS, EXPRESSIONS, HAND = 55, 10, 10, 45
#: Version 1.0 has 10 shape and 10 expression values, later ones 300 and 100.
_FEWEST_DIRECTIONS, _MOST_DIRECTIONS = BETAS + EXPRESSIONS, 400


@dataclass(frozen=True, slots=True)
class Spaces:
    """How many shape and expression values a body has; a file may hold more."""

    betas: int
    expressions: int


OWN = Spaces(BETAS, EXPRESSIONS)
#: Those that PIXIE regresses, of a file that has them.
PIXIES = Spaces(200, 50)


@dataclass(frozen=True, slots=True)
class _Expected:
    """One array of the model.

    Attributes:
        shape: With -1 for the number of shape directions, which differs between versions.
        below: Exclusive bound of the values of an array of indices; 0 for real numbers.
    """

    shape: tuple[int, ...]
    below: int = 0

    def __str__(self) -> str:
        sizes = (
            f"{_FEWEST_DIRECTIONS} to {_MOST_DIRECTIONS}" if size < 0 else str(size)
            for size in self.shape
        )
        return f"({', '.join(sizes)})"

    def fits(self, shape: tuple[int, ...]) -> bool:
        return len(shape) == len(self.shape) and all(
            _FEWEST_DIRECTIONS <= there <= _MOST_DIRECTIONS if size < 0 else there == size
            for there, size in zip(shape, self.shape, strict=True)
        )


#: What the package takes from the file; the rest, such as tables of part names, is never read.
_ARRAYS = {
    "v_template": _Expected((_VERTICES, 3)),
    "shapedirs": _Expected((_VERTICES, 3, -1)),
    "posedirs": _Expected((_VERTICES, 3, 9 * (JOINTS - 1))),
    "J_regressor": _Expected((JOINTS, _VERTICES)),
    "weights": _Expected((_VERTICES, JOINTS)),
    "kintree_table": _Expected((2, JOINTS), below=JOINTS),
    "f": _Expected((_FACES, 3), below=_VERTICES),
    "hands_componentsl": _Expected((HAND, HAND)),
    "hands_componentsr": _Expected((HAND, HAND)),
    "hands_meanl": _Expected((HAND,)),
    "hands_meanr": _Expected((HAND,)),
    "lmk_faces_idx": _Expected((_LANDMARKS,), below=_FACES),
    "lmk_bary_coords": _Expected((_LANDMARKS, 3)),
}


def load_model(path: Path | None, spaces: Spaces = OWN) -> Any:
    """The package's model of a file, without gradients of its own.

    A file with fewer values than ``spaces`` asks for has 10 of each.

    Raises:
        MissingPart: no file, or no package ``smplx``.
        DataError: the file is not SMPL-X, or cannot be read without running what it holds.
    """
    there = require_model(path)
    return _loaded(there, there.stat().st_mtime_ns, spaces)


def require_model(path: Path | None) -> Path:
    """The model file, if it is there, and the package that reads it.

    Raises:
        MissingPart: one of them is not.
    """
    if path is None or not path.is_file():
        raise MissingPart(
            "the body model SMPL-X has no model file" if path is None else f"no file at {path}",
            expected="SMPLX_NEUTRAL.npz or .pkl",
            hint=_WHERE,
        )
    if importlib.util.find_spec("smplx") is None:
        raise _no_package()
    return path


def _no_package() -> MissingPart:
    return not_installed("smplx", "the body model SMPL-X")


def forget() -> None:
    """The model is read anew when it is next asked for."""
    _loaded.cache_clear()


@functools.lru_cache(maxsize=1)
def _loaded(path: Path, changed_ns: int, spaces: Spaces) -> Any:  # noqa: ARG001 - a changed file is read again
    try:
        import smplx
    except ImportError as error:
        raise _no_package() from error
    arrays: dict[str, Any] = checked_model(path)
    if arrays["shapedirs"].shape[2] < _MOST_DIRECTIONS:
        spaces = OWN
    with tempfile.TemporaryDirectory(prefix="smplx-") as folder:
        copy = Path(folder) / "checked.npz"
        np.savez(copy, **arrays)
        del arrays
        # It prints a remark about files of version 1.0, and standard output is the command's.
        with contextlib.redirect_stdout(sys.stderr):
            model = smplx.SMPLX(
                str(copy),
                ext="npz",
                num_betas=spaces.betas,
                num_expression_coeffs=spaces.expressions,
                use_pca=False,
                flat_hand_mean=True,
            )
    return model.requires_grad_(requires_grad=False)


def checked_model(path: Path) -> dict[str, NDArray[Any]]:
    """The model's arrays, of the right shapes, finite, with indices that point at something.

    Raises:
        DataError: the file is not SMPL-X, or cannot be read without running what it holds.
    """
    if path.suffix not in (".npz", ".pkl"):
        raise DataError(f"{path} is no SMPL-X model", expected="an .npz or .pkl file", hint=_WHERE)
    read = read_array_npz if path.suffix == ".npz" else read_array_pickle
    try:
        arrays = read(path, _ARRAYS)
    except DataError as error:
        raise DataError(
            f"{path} is no SMPL-X model", got=error.got or error.what, hint=_WHERE
        ) from error
    missing = [name for name in _ARRAYS if name not in arrays]
    if missing:
        raise DataError(
            f"{path} is no SMPL-X model",
            expected=f"an array {missing[0]}",
            got=", ".join(sorted(arrays)) or "none of its arrays",
            hint=_WHERE,
        )
    for name, expected in _ARRAYS.items():
        if not expected.fits(arrays[name].shape):
            raise DataError(
                f"{path} is not SMPL-X but another model: its {name} has another shape",
                expected=str(expected),
                got=str(arrays[name].shape),
                hint=_WHERE,
            )
    return {name: _values(path, name, arrays.pop(name)) for name in _ARRAYS}


def _values(path: Path, name: str, array: NDArray[Any]) -> NDArray[Any]:
    below = _ARRAYS[name].below
    if array.dtype.kind not in "fiu":
        raise DataError(
            f"{path} is damaged: {name} holds {array.dtype} and no numbers", hint=_WHERE
        )
    if not below:
        # Real models reach 1; beyond float32 there is nothing but damage.
        if not np.isfinite(array).all() or np.abs(array).max() > 1e6:
            raise DataError(f"{path} is damaged: {name} holds no sound numbers", hint=_WHERE)
        return array.astype(np.float32)
    indices = array.astype(np.int64)
    if name == "kintree_table":
        # Each joint hangs on an earlier one; the root on none, whatever number says so.
        parents = indices[0, 1:]
        sound = (parents >= 0).all() and (parents <= np.arange(JOINTS - 1)).all()
    else:
        sound = bool(((indices >= 0) & (indices < below)).all())
    if not sound or (array != indices).any():
        raise DataError(f"{path} is damaged: {name} points at nothing", hint=_WHERE)
    return indices
