"""The tensors of a network in a checkpoint: all of them, of their shapes, and no others."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.array_files.checkpoints import Checkpoint
from harness.core.errors import DataError

_SHOWN = 3


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
                got=str(there[name].shape),
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
    shown = [name[:80].encode("unicode_escape").decode() for name in list(names)[:_SHOWN]]
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
