"""The stack machine that runs a pickle's instructions, without any way to call a function.

Only the instructions that write numbers, text, bytes, lists, tuples and dictionaries are known.
What a pickle names, calls or sets goes to an ``Objects``, which decides what becomes of it. The
format: Python's ``pickletools``, protocols 0 to 5.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from typing import BinaryIO, Protocol, cast

import numpy as np

#: Arrays take some ten instructions each; each instruction holds at most a few hundred bytes.
MOST_STEPS = 200_000
_MOST_DIGITS = 40
_MOST_INDEX = 2**31
#: Longer text can only be the bytes of an array; other text takes four bytes per character.
_LONG_TEXT = 256
#: From this first byte on, UTF-8 encodes characters that are not in Latin-1.
_BEYOND_LATIN1 = 0xC4
_ESCAPE_BEYOND_LATIN1 = re.compile(rb"\\u(?!00)|\\U")


class Refused(ValueError):
    """A pickle is broken, or does more than arrays need; the message is part of a sentence."""


class Objects(Protocol):
    """What becomes of the names, calls and states in a pickle."""

    def named(self, module: str, name: str) -> object:
        """What stands for a class or function."""
        ...

    def called(self, function: object, arguments: object) -> object:
        """What stands for the outcome of a call."""
        ...

    def given(self, target: object, state: object) -> object:
        """What stands for an object after its state was set."""
        ...


def run_pickle(stream: BinaryIO, size: int, objects: Objects) -> object:
    """The value that a pickle writes.

    Args:
        stream: Stands at the pickle's start.
        size: Number of bytes in it; no read asks for more.
        objects: Stands for everything that is not plain.

    Raises:
        Refused: an instruction that arrays do not need, too many of them, or a broken file.
    """
    return _Machine(stream, size, objects).run()


class _Machine:
    def __init__(self, stream: BinaryIO, size: int, objects: Objects) -> None:
        self._stream = stream
        self._left = size
        self._objects = objects
        self._stack: list[object] = []
        self._below: list[list[object]] = []  # what stood under each open mark
        self._memo: dict[int, object] = {}

    def run(self) -> object:
        for _ in range(MOST_STEPS):
            code = self._bytes(1)
            if code == b".":
                return self._pop()
            if code not in _INSTRUCTIONS:
                raise Refused(f"it holds the instruction {code!r}, which arrays do not need")
            _INSTRUCTIONS[code](self)
        raise Refused(f"it holds more than {MOST_STEPS} instructions")

    # Reading. Lengths are compared with the remaining bytes before memory is allocated.

    def _bytes(self, count: int) -> bytes:
        if not 0 <= count <= self._left:
            raise Refused(f"it ends where {count} more bytes were promised")
        self._left -= count
        content = self._stream.read(count)
        if len(content) != count:
            raise Refused("it became shorter while it was read")
        return content

    def _number(self, form: str) -> int:
        return int(struct.unpack(form, self._bytes(struct.calcsize(form)))[0])

    def _line(self, most: int = -1) -> bytes:
        line = self._stream.readline(most)
        self._left -= len(line)
        if not line.endswith(b"\n"):
            raise Refused("it holds a line without an end")
        return line[:-1]

    def _sized(self, form: str) -> bytes:
        return self._bytes(self._number(form))

    # The stack.

    def push(self, value: object) -> None:
        self._stack.append(value)

    def _pop(self) -> object:
        if not self._stack:
            raise Refused("it takes a value where none is")
        return self._stack.pop()

    def _top(self) -> object:
        if not self._stack:
            raise Refused("it takes a value where none is")
        return self._stack[-1]

    def _since_mark(self) -> list[object]:
        if not self._below:
            raise Refused("it goes back to a mark that is not there")
        values, self._stack = self._stack, self._below.pop()
        return values

    def mark(self) -> None:
        self._below.append(self._stack)
        self._stack = []

    def pop(self) -> None:
        if self._stack:
            self._stack.pop()
        else:
            self._since_mark()

    def pop_mark(self) -> None:
        self._since_mark()

    def duplicate(self) -> None:
        self.push(self._top())

    def skip(self, count: int) -> None:
        self._bytes(count)

    # Numbers and text.

    def integer(self, form: str) -> None:
        self.push(self._number(form))

    def integer_line(self) -> None:
        line = self._line(_MOST_DIGITS)
        self.push({b"00": False, b"01": True}.get(line, int(line.rstrip(b"L"))))

    def long_integer(self, form: str) -> None:
        self.push(int.from_bytes(self._bytes(self._number(form)), "little", signed=True))

    def real(self) -> None:
        self.push(struct.unpack(">d", self._bytes(8))[0])

    def real_line(self) -> None:
        self.push(float(self._line(_MOST_DIGITS)))

    def bytes_sized(self, form: str) -> None:
        self.push(self._sized(form))

    def quoted_line(self) -> None:
        line = self._line()
        if len(line) < 2 or line[:1] != line[-1:] or line[:1] not in (b"'", b'"'):
            raise Refused("it holds text without quotes")
        if len(line) > _LONG_TEXT and _ESCAPE_BEYOND_LATIN1.search(line):
            raise Refused("it holds long text that is no bytes")
        # Python 2 wrote the bytes of arrays as text with escapes.
        self.push(line[1:-1].decode("unicode_escape").encode("latin1"))

    def text_line(self) -> None:
        line = self._line()
        if len(line) > _LONG_TEXT and _ESCAPE_BEYOND_LATIN1.search(line):
            raise Refused("it holds long text that is no bytes")
        self.push(line.decode("raw_unicode_escape"))

    def text_sized(self, form: str) -> None:
        content = self._sized(form)
        if len(content) > _LONG_TEXT and np.frombuffer(content, np.uint8).max() >= _BEYOND_LATIN1:
            raise Refused("it holds long text that is no bytes")
        self.push(content.decode("utf-8"))

    # Containers.

    def new_list(self) -> None:
        self.push([])

    def new_dictionary(self) -> None:
        self.push({})

    def list_since_mark(self) -> None:
        self.push(self._since_mark())

    def tuple_since_mark(self) -> None:
        self.push(tuple(self._since_mark()))

    def dictionary_since_mark(self) -> None:
        values = self._since_mark()
        self.push({})
        self._enter(values)

    def short_tuple(self, count: int) -> None:
        values = [self._pop() for _ in range(count)]
        self.push(tuple(reversed(values)))

    def append(self) -> None:
        self._extend([self._pop()])

    def appends(self) -> None:
        self._extend(self._since_mark())

    def _extend(self, values: list[object]) -> None:
        target = self._top()
        if isinstance(target, list):
            cast("list[object]", target).extend(values)

    def set_item(self) -> None:
        value, key = self._pop(), self._pop()
        self._enter([key, value])

    def set_items(self) -> None:
        self._enter(self._since_mark())

    def _enter(self, values: list[object]) -> None:
        target = self._top()
        if len(values) % 2:
            raise Refused("it holds a key without a value")
        if isinstance(target, dict):
            keys = [_key(value) for value in values[::2]]
            cast("dict[object, object]", target).update(zip(keys, values[1::2], strict=True))

    # The memo, with which a pickle refers to earlier values.

    def _remember(self, index: int) -> None:
        if not 0 <= index < _MOST_INDEX:
            raise Refused(f"it remembers a value under {index}")
        self._memo[index] = self._top()

    def _recall(self, index: int) -> None:
        if index not in self._memo:
            raise Refused(f"it refers to a value {index} that it never wrote")
        self.push(self._memo[index])

    def remember_next(self) -> None:
        self._remember(len(self._memo))

    def remember(self, form: str) -> None:
        self._remember(self._number(form))

    def remember_line(self) -> None:
        self._remember(int(self._line(_MOST_DIGITS)))

    def recall(self, form: str) -> None:
        self._recall(self._number(form))

    def recall_line(self) -> None:
        self._recall(int(self._line(_MOST_DIGITS)))

    # Names, calls and states.

    def name_lines(self) -> None:
        module, name = self._line(_LONG_TEXT), self._line(_LONG_TEXT)
        self.push(self._objects.named(module.decode(), name.decode()))

    def name_from_stack(self) -> None:
        name, module = self._pop(), self._pop()
        if not isinstance(name, str) or not isinstance(module, str):
            raise Refused("it names something by what is no text")
        self.push(self._objects.named(module, name))

    def call(self) -> None:
        arguments, function = self._pop(), self._pop()
        self.push(self._objects.called(function, arguments))

    def call_with_keywords(self) -> None:
        self._pop()
        self.call()

    def set_state(self) -> None:
        state, target = self._pop(), self._pop()
        self.push(self._objects.given(target, state))


def _key(value: object) -> str | int:
    """A dictionary's key, if it is one that cannot be chosen to make look-ups slow."""
    if isinstance(value, bytes):
        return value.decode("latin1")
    if isinstance(value, str) or (isinstance(value, int) and abs(value) < _MOST_INDEX):
        return value
    raise Refused(f"it has a key that is neither text nor a small number: {type(value).__name__}")


def _pushing(value: object) -> Callable[[_Machine], None]:
    return lambda machine: machine.push(value)


_INSTRUCTIONS: dict[bytes, Callable[[_Machine], None]] = {
    b"\x80": lambda machine: machine.skip(1),  # protocol
    b"\x95": lambda machine: machine.skip(8),  # frame
    b"(": _Machine.mark,
    b"0": _Machine.pop,
    b"1": _Machine.pop_mark,
    b"2": _Machine.duplicate,
    b"N": _pushing(None),
    b"\x88": _pushing(True),
    b"\x89": _pushing(False),
    b"I": _Machine.integer_line,
    b"L": _Machine.integer_line,
    b"J": lambda machine: machine.integer("<i"),
    b"K": lambda machine: machine.integer("<B"),
    b"M": lambda machine: machine.integer("<H"),
    b"\x8a": lambda machine: machine.long_integer("<B"),
    b"F": _Machine.real_line,
    b"G": _Machine.real,
    b"S": _Machine.quoted_line,
    b"T": lambda machine: machine.bytes_sized("<i"),
    b"U": lambda machine: machine.bytes_sized("<B"),
    b"B": lambda machine: machine.bytes_sized("<I"),
    b"C": lambda machine: machine.bytes_sized("<B"),
    b"\x8e": lambda machine: machine.bytes_sized("<Q"),
    b"\x96": lambda machine: machine.bytes_sized("<Q"),  # a bytearray, which nobody changes here
    b"V": _Machine.text_line,
    b"X": lambda machine: machine.text_sized("<I"),
    b"\x8c": lambda machine: machine.text_sized("<B"),
    b"\x8d": lambda machine: machine.text_sized("<Q"),
    b"]": _Machine.new_list,
    b"l": _Machine.list_since_mark,
    b"a": _Machine.append,
    b"e": _Machine.appends,
    b")": _pushing(()),
    b"t": _Machine.tuple_since_mark,
    b"\x85": lambda machine: machine.short_tuple(1),
    b"\x86": lambda machine: machine.short_tuple(2),
    b"\x87": lambda machine: machine.short_tuple(3),
    b"}": _Machine.new_dictionary,
    b"d": _Machine.dictionary_since_mark,
    b"s": _Machine.set_item,
    b"u": _Machine.set_items,
    b"\x94": _Machine.remember_next,
    b"p": _Machine.remember_line,
    b"q": lambda machine: machine.remember("<B"),
    b"r": lambda machine: machine.remember("<I"),
    b"g": _Machine.recall_line,
    b"h": lambda machine: machine.recall("<B"),
    b"j": lambda machine: machine.recall("<I"),
    b"c": _Machine.name_lines,
    b"\x93": _Machine.name_from_stack,
    b"R": _Machine.call,
    b"\x81": _Machine.call,
    b"\x92": _Machine.call_with_keywords,
    b"b": _Machine.set_state,
}
