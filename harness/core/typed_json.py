"""Frozen dataclasses as JSON and back: the one place where values of ours meet their stored form.

A dataclass is an object with one key for each field; a mapping is an object, a tuple an array, an
enum its value. Reading follows the annotations of the fields and is strict: every field must be
there, nothing else may be, and each value must be of its type. A field annotated ``object`` holds
any JSON value as it is. What was written is read back equal, to the last bit of a float.
"""

import dataclasses
import functools
import types
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from pathlib import Path, PurePath
from typing import Any, Literal, TypeGuard, TypeVar, Union, get_args, get_origin, get_type_hints

from harness.core.errors import DataError

T = TypeVar("T")

_MOST_SHOWN = 120
_NAMES: Mapping[Any, str] = {str: "text", int: "a whole number", bool: "true or false"}


class _Unfit(Exception):
    """A value that is not of its field's type."""

    def __init__(
        self, expected: str, got: str, place: str = "", *, is_choice: bool = False
    ) -> None:
        # Whoever wrote the file chose names and values, and with them how long a message would be.
        self.place, self.expected, self.got = place[-_MOST_SHOWN:], expected, got[:_MOST_SHOWN]
        self.is_choice = is_choice
        super().__init__(self.place, expected, self.got)

    def move_below(self, name: object) -> None:
        """The place is one of what has this name."""
        self.place = (f"{name}.{self.place}" if self.place else str(name))[-_MOST_SHOWN:]


def to_json(value: Any) -> Any:
    """Plain JSON values: objects for dataclasses and mappings, arrays for tuples, paths as text."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, PurePath):
        return str(value)
    if dataclasses.is_dataclass(value):
        return {f.name: to_json(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if is_mapping(value):
        return {str(name): to_json(entry) for name, entry in value.items()}
    if is_array(value):
        return [to_json(entry) for entry in value]
    return value


def from_json(kind: type[T], document: object, source: str | Path, noun: str) -> T:
    """The value of a dataclass behind ``to_json``.

    Args:
        kind: The dataclass.
        document: What JSON gave.
        source: Where it came from, for the message.
        noun: What it should be, such as ``a record``.

    Raises:
        DataError: a field that is missing, unknown or of another type, with its place.
    """
    try:
        made: T = _reader(kind)(document)
    except _Unfit as error:
        if error.is_choice:
            raise DataError(
                f"{source} has an unknown {error.place}", expected=error.expected, got=error.got
            ) from error
        raise DataError(
            f"{source} is not {noun}",
            expected=f"{error.expected} at '{error.place}'" if error.place else error.expected,
            got=error.got,
        ) from error
    return made


_Reader = Callable[[Any], Any]


@functools.cache
def _reader(kind: Any) -> _Reader:
    """What reads the values of an annotation."""
    if kind is object:
        return lambda value: value
    if dataclasses.is_dataclass(kind):
        return functools.partial(_read_dataclass, kind)
    origin = get_origin(kind)
    if origin is None:
        return functools.partial(_read_plain, kind)
    return functools.partial(_READERS.get(origin, _read_mapping), get_args(kind))


def _each(named: Iterable[tuple[Any, _Reader, Any]]) -> dict[Any, Any]:
    """The values of entries by name, each given with its reader."""
    found: dict[Any, Any] = {}
    for name, read, value in named:
        try:
            found[name] = read(value)
        except _Unfit as error:
            error.move_below(name)
            raise
    return found


def _read_dataclass(kind: Any, value: Any) -> Any:
    entries, readers = _object(value), _field_readers(kind)
    for name in entries.keys() - readers.keys():
        raise _Unfit("no such field", "one", str(name))
    for name in readers:
        if name not in entries:
            raise _Unfit("a field", "none", name)
    return kind(**_each((name, read, entries[name]) for name, read in readers.items()))


@functools.cache
def _field_readers(kind: Any) -> Mapping[str, _Reader]:
    found = get_type_hints(kind)
    return {field.name: _reader(found[field.name]) for field in dataclasses.fields(kind)}


def _read_union(kinds: tuple[Any, ...], value: Any) -> Any:
    if value is None and types.NoneType in kinds:
        return None
    left = [kind for kind in kinds if kind is not types.NoneType]
    for kind in left[:-1]:
        try:
            return _reader(kind)(value)
        except _Unfit:
            continue
    return _reader(left[-1])(value)


def _read_choice(choices: tuple[Any, ...], value: Any) -> Any:
    if value not in choices:
        expected = ", ".join(str(choice) for choice in choices)
        raise _Unfit(expected, str(value), is_choice=True)
    return value


def _read_tuple(kinds: tuple[Any, ...], value: Any) -> Any:
    if not is_array(value):
        raise _Unfit("an array", type(value).__name__)
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    if len(value) != len(kinds):
        raise _Unfit(f"{len(kinds)} entries", str(len(value)))
    readers = map(_reader, kinds)
    return tuple(_each(zip(range(len(value)), readers, value, strict=True)).values())


def _read_mapping(kinds: tuple[Any, ...], value: Any) -> Any:
    read = _reader(kinds[1])
    return _each((name, read, entry) for name, entry in _object(value).items())


#: Readers of annotations with arguments; what is none of these is a mapping with text for keys.
_READERS: Mapping[Any, Callable[[tuple[Any, ...], Any], Any]] = {
    Union: _read_union,
    types.UnionType: _read_union,
    Literal: _read_choice,
    tuple: _read_tuple,
}


def _read_plain(kind: Any, value: Any) -> Any:
    if type(value) is kind:
        return value
    if issubclass(kind, Enum):
        return kind(_read_choice(tuple(member.value for member in kind), value))
    if issubclass(kind, PurePath):
        return kind(_read_plain(str, value))
    # A whole number stays one where a number is wanted: it is written as it was read.
    if kind is float and type(value) is int:
        return value
    expected = "a number" if kind is float else _NAMES.get(kind, str(kind))
    raise _Unfit(expected, type(value).__name__)


def _object(value: Any) -> Mapping[str, Any]:
    if not is_mapping(value):
        raise _Unfit("an object", type(value).__name__)
    return value


def is_mapping(value: Any) -> TypeGuard[Mapping[str, Any]]:
    """Whether a JSON value is an object."""
    # Whatever JSON gave is a dict, which is told much sooner.
    return isinstance(value, dict | Mapping)


def is_array(value: Any) -> TypeGuard[list[Any] | tuple[Any, ...]]:
    """Whether a JSON value is an array, or will be one."""
    return isinstance(value, list | tuple)
