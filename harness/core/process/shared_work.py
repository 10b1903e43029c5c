"""Work that several methods do alike on the same photos, such as a body fit, made once.

A method says what it wants made and what that depends on; the pipeline lends it a ``Sharing`` that
knows whether it was made before. Without one, ``alone`` makes everything anew.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from numpy.typing import NDArray

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Work(Generic[T]):
    """Something to be made, with everything that decides what comes out.

    Attributes:
        name: What it is, such as ``body fit``.
        module: The module whose import closure makes it.
        inputs: All that decides the outcome besides code: JSON values.
        make: Makes it.
        packed: Its form in arrays; lossless.
        unpacked: The value behind ``packed``.
    """

    name: str
    module: str
    inputs: Mapping[str, object]
    make: Callable[[], T]
    packed: Callable[[T], Mapping[str, NDArray[Any]]]
    unpacked: Callable[[Mapping[str, NDArray[Any]]], T]


class Sharing(Protocol):
    """Makes work, or hands out what was made of equal inputs by equal code."""

    def __call__(self, work: Work[T]) -> T:
        """The outcome of some work."""
        ...


def alone(work: Work[T]) -> T:
    """The outcome of some work, made anew."""
    return work.make()
