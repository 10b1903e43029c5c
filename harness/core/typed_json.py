"""Frozen dataclasses as JSON and back: the one place where values of ours meet their stored form.

A dataclass is an object with one key for each field; a mapping is an object, a tuple an array, an
enum its value. Reading follows the annotations of the fields and is strict: every field must be
there, nothing else may be, and each value must be of its type. A field annotated ``object`` holds
any JSON value as it is. What was written is read back equal, to the last bit of a float.
"""

import dataclasses
import functools
import types
from collections.abc import Callable, Mapping
from enum import Enum
from pathlib import Path, PurePath
from typing import Any, Literal, TypeGuard, TypeVar, Union, get_args, get_origin, get_type_hints

from harness.core.errors import DataError

T = TypeVar("T")

_MOST_SHOWN = 120
_NAMES: Mapping[Any, str] = {str: "text", int: "a whole number", bool: "true or false"}


class _Unfit(Exception):
    """A value that is not of its field's type."""

    def __init__(self, place: str, expected: str, got: str, *, is_choice: bool = False) -> None:
        # Whoever wrote the file chose names and values, and with them how long a message would be.
        place, got = place[-_MOST_SHOWN:], got[:_MOST_SHOWN]
        super().__init__(place, expected, got)
        self.place, self.expected, self.got, self.is_choice = place, expected, got, is_choice


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
        made: T = _read(kind, document, "")
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


def _read(kind: Any, value: Any, place: str) -> Any:
    if kind is object:
        return value
    if dataclasses.is_dataclass(kind):
        return _read_dataclass(kind, value, place)
    origin = get_origin(kind)
    if origin is None:
        return _read_plain(kind, value, place)
    return _READERS.get(origin, _read_mapping)(get_args(kind), value, place)


def _read_dataclass(kind: Any, value: Any, place: str) -> Any:
    entries = _object(value, place)
    hints = _hints(kind)
    for name in entries.keys() - hints.keys():
        raise _Unfit(_below(place, name), "no such field", "one")
    for name in hints:
        if name not in entries:
            raise _Unfit(_below(place, name), "a field", "none")
    return kind(**{name: _read(hints[name], entries[name], _below(place, name)) for name in hints})


@functools.cache
def _hints(kind: Any) -> Mapping[str, Any]:
    found = get_type_hints(kind)
    return {field.name: found[field.name] for field in dataclasses.fields(kind)}


def _read_union(kinds: tuple[Any, ...], value: Any, place: str) -> Any:
    if value is None and types.NoneType in kinds:
        return None
    left = [kind for kind in kinds if kind is not types.NoneType]
    for kind in left[:-1]:
        try:
            return _read(kind, value, place)
        except _Unfit:
            continue
    return _read(left[-1], value, place)


def _read_choice(choices: tuple[Any, ...], value: Any, place: str) -> Any:
    if value not in choices:
        expected = ", ".join(str(choice) for choice in choices)
        raise _Unfit(place, expected, str(value), is_choice=True)
    return value


def _read_tuple(kinds: tuple[Any, ...], value: Any, place: str) -> Any:
    if not is_array(value):
        raise _Unfit(place, "an array", type(value).__name__)
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    if len(value) != len(kinds):
        raise _Unfit(place, f"{len(kinds)} entries", str(len(value)))
    pairs = zip(kinds, value, strict=True)
    return tuple(_read(kind, entry, _below(place, i)) for i, (kind, entry) in enumerate(pairs))


def _read_mapping(kinds: tuple[Any, ...], value: Any, place: str) -> Any:
    entries = _object(value, place)
    return {name: _read(kinds[1], entry, _below(place, name)) for name, entry in entries.items()}


#: Readers of annotations with arguments; what is none of these is a mapping with text for keys.
_READERS: Mapping[Any, Callable[[tuple[Any, ...], Any, str], Any]] = {
    Union: _read_union,
    types.UnionType: _read_union,
    Literal: _read_choice,
    tuple: _read_tuple,
}


def _read_plain(kind: Any, value: Any, place: str) -> Any:
    if issubclass(kind, Enum):
        return kind(_read_choice(tuple(member.value for member in kind), value, place))
    if issubclass(kind, PurePath):
        return kind(_read_plain(str, value, place))
    if kind is float:
        # A whole number stays one: it is a number, and is written as it was read.
        if isinstance(value, float | int) and not isinstance(value, bool):
            return value
        raise _Unfit(place, "a number", type(value).__name__)
    if issubclass(kind, PurePath) and isinstance(value, str):
        return kind(value)
    if type(value) is not kind:
        raise _Unfit(place, _NAMES.get(kind, str(kind)), type(value).__name__)
    return value


def _object(value: Any, place: str) -> Mapping[str, Any]:
    if not is_mapping(value):
        raise _Unfit(place, "an object", type(value).__name__)
    return value


def is_mapping(value: Any) -> TypeGuard[Mapping[str, Any]]:
    """Whether a JSON value is an object."""
    return isinstance(value, Mapping)


def is_array(value: Any) -> TypeGuard[list[Any] | tuple[Any, ...]]:
    """Whether a JSON value is an array, or will be one."""
    return isinstance(value, list | tuple)


def _below(place: str, name: object) -> str:
    return f"{place}.{name}" if place else str(name)
