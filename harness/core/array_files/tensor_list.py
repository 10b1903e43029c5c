"""The list of tensors in a file of ``torch.save``, a pickle of dictionaries, without executing it.

The pickle is run by our own stack machine, which cannot call a function. Dictionaries and tensors
are rebuilt; everything else becomes a name without meaning.
"""

from __future__ import annotations

import io
import math
import pickletools
from dataclasses import dataclass
from typing import cast

from harness.core.array_files.pickle_machine import MOST_STEPS, Refused, run_pickle

#: numpy's code of each kind of memory; bfloat16 is the upper half of a float32.
STORAGES = {
    "FloatStorage": "<f4",
    "DoubleStorage": "<f8",
    "HalfStorage": "<f2",
    "BFloat16Storage": "<u2",
    "LongStorage": "<i8",
    "IntStorage": "<i4",
    "ShortStorage": "<i2",
    "CharStorage": "|i1",
    "ByteStorage": "|u1",
    "BoolStorage": "|b1",
}
#: No network that is known has a tensor of more than 10 million numbers.
_MOST_NUMBERS = 2**26
_MOST_DIMENSIONS, _MOST_INDEX = 8, 2**40


@dataclass(frozen=True, slots=True)
class StoredTensor:
    """A tensor whose numbers have not been read.

    Attributes:
        shape: Its sizes.
        storage: Kind of its memory, such as ``FloatStorage``.
        member: Number of its memory in the archive.
        count: Numbers in that memory.
        offset: Where it begins there.
        strides: Distance of neighbours there, by dimension.
    """

    shape: tuple[int, ...]
    storage: str
    member: str
    count: int
    offset: int
    strides: tuple[int, ...]

    @property
    def fits(self) -> bool:
        """Whether all its numbers are in its memory."""
        if 0 in self.shape:
            return True
        pairs = zip(self.shape, self.strides, strict=True)
        last = self.offset + sum((size - 1) * stride for size, stride in pairs)
        return last < self.count


@dataclass(frozen=True, slots=True)
class _Storage:
    """A kind of memory, as the id of a tensor's memory names it."""

    name: str


@dataclass(frozen=True, slots=True)
class _Function:
    """One of the few functions whose outcome is known: it rebuilds a tensor or a dictionary."""

    name: str


class _Foreign(str):
    """Stands for what is not rebuilt. It is text, so that it may also be a dictionary's key."""

    __slots__ = ()


_FUNCTIONS = (
    ("collections", "OrderedDict"),
    ("torch._utils", "_rebuild_tensor"),
    ("torch._utils", "_rebuild_tensor_v2"),
    ("torch._utils", "_rebuild_parameter"),
)


def read_tensor_list(program: bytes) -> object:
    """What a pickle of dictionaries and tensors writes.

    Raises:
        Refused, ArithmeticError, LookupError, SyntaxError, TypeError, ValueError: it is broken, or
            does more than that.
    """
    plain = _without_persistent_ids(program)
    return run_pickle(io.BytesIO(plain), len(plain), _Tensors())


def _without_persistent_ids(program: bytes) -> bytes:
    """A pickle without the instructions that replace the id of a tensor's memory by the memory.

    The id, a tuple, then stands for it; the other instructions are the same.
    """
    kept: list[bytes] = []
    begin = 0
    for step, (code, _, position) in enumerate(pickletools.genops(program)):
        if step > MOST_STEPS or position is None:
            raise Refused(f"it holds more than {MOST_STEPS} instructions")
        if code.name == "BINPERSID":
            kept.append(program[begin:position])
            begin = position + 1
    return b"".join([*kept, program[begin:]])


class _Tensors:
    """What becomes of names, calls and states: tensors, dictionaries, or names without meaning."""

    def named(self, module: str, name: str) -> object:
        if module == "torch" and name in STORAGES:
            return _Storage(name)
        return _Function(name) if (module, name) in _FUNCTIONS else _Foreign(f"{module}.{name}")

    def called(self, function: object, arguments: object) -> object:
        if isinstance(function, _Foreign):
            return function
        if not isinstance(function, _Function) or not isinstance(arguments, tuple):
            raise Refused("it calls what is no function")
        given = cast("tuple[object, ...]", arguments)
        if function.name == "OrderedDict" and not given:
            return dict[object, object]()
        if function.name == "_rebuild_parameter" and given and isinstance(given[0], StoredTensor):
            return given[0]
        if function.name.startswith("_rebuild_tensor") and len(given) >= 4:
            return _tensor(given)
        return _Foreign(function.name)

    def given(self, target: object, state: object) -> object:  # noqa: ARG002 - what has one is foreign
        return target


def _tensor(given: tuple[object, ...]) -> object:
    """The tensor of memory, offset, shape and strides, and of arguments that do not matter."""
    memory, (offset,) = _values(given[0]), _whole((given[1],))
    shape, strides = _whole(_values(given[2])), _whole(_values(given[3]))
    if len(shape) != len(strides) or len(shape) > _MOST_DIMENSIONS:
        raise Refused("it holds a tensor of an impossible shape")
    if math.prod(shape) > _MOST_NUMBERS:
        raise Refused(f"it holds a tensor of more than {_MOST_NUMBERS} numbers")
    if len(memory) < 5 or not isinstance(memory[1], _Storage):
        return _Foreign("a tensor of another kind")
    member, (count,) = memory[2], _whole((memory[4],))
    if not isinstance(member, str) or not (member.isascii() and member.isdigit()):
        raise Refused("it holds a tensor whose memory is nowhere")
    return StoredTensor(shape, memory[1].name, member, count, offset, strides)


def _values(value: object) -> tuple[object, ...]:
    return cast("tuple[object, ...]", value) if isinstance(value, tuple) else (None,)


def _whole(values: tuple[object, ...]) -> tuple[int, ...]:
    """The same values, which are all numbers that a place or size may be."""
    numbers = tuple(v for v in values if isinstance(v, int) and 0 <= v < _MOST_INDEX)
    if len(numbers) != len(values):
        raise Refused("it holds a tensor of an impossible shape")
    return numbers
