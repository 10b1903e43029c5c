"""What differs between two sets of inputs, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeGuard

from harness.core.files.hashing import canonical_json

_LONGEST = 40
_SHOWN = 4
#: Values of these keys are hashes, so only the fact that one changed can be shown.
_HASHED = ("code", "sha256")
_WORDS = {"code": "code of", "packages": "package", "sha256": "file"}


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """One entry per value that is not the same, such as ``package scipy 1.17.1 -> 1.18.0``.

    A nested value is named by its path. Digests of modules are below ``code``, versions of packages
    below ``packages``, and hashes of files below ``sha256``.
    """
    return list(_walk((), before, now))


def listed_differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """The first few differences in one line, and how many more there are."""
    found = differences(before, now)
    more = [f"{len(found) - _SHOWN} more"] if len(found) > _SHOWN else []
    return ", ".join([*found[:_SHOWN], *more])


def _walk(path: tuple[str, ...], before: Any, now: Any) -> Iterator[str]:
    # Compared as JSON, because values read from a file have lists in place of tuples.
    if canonical_json(before) == canonical_json(now):
        return
    if _is_mapping(before) and _is_mapping(now):
        for name in dict.fromkeys([*before, *now]):
            yield from _walk((*path, name), before.get(name), now.get(name))
        return
    yield _told(path, before, now)


def _is_mapping(value: Any) -> TypeGuard[Mapping[str, Any]]:
    return isinstance(value, Mapping)


def _told(path: tuple[str, ...], before: Any, now: Any) -> str:
    *_, kind, last = ("", *path)
    name = f"{_WORDS[kind]} {last}" if kind in _WORDS else " ".join(path)
    old, new = _text(before), _text(now)
    if kind in _HASHED or max(len(old), len(new)) > _LONGEST:
        if before is None or now is None:
            return f"{name} ({'new' if before is None else 'gone'})"
        return name
    return f"{name} {old} -> {new}"


def _text(value: Any) -> str:
    return "none" if value in (None, "") else str(value)
