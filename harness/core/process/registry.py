"""Lazy registries: a name becomes an object on first use, so listing names imports nothing."""

import functools
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Protocol, runtime_checkable

from harness.core.errors import HarnessError, MissingPart, did_you_mean
from harness.core.missing import explained


class Registry:
    """Lazy ``"module:object"`` targets by name, open to third parties by entry points.

    Args:
        kind: What is registered, for messages, such as ``method``.
        targets: Built-in names; a third party cannot replace them.
        group: Entry-point group for third parties, or an empty string for none.
    """

    def __init__(self, kind: str, targets: dict[str, str], group: str = "") -> None:
        self.kind = kind
        self._targets = dict(targets)
        self._group = group

    def targets(self) -> dict[str, str]:
        """All names with their targets; a built-in name takes precedence over a third party's."""
        return {**(_found(self._group, tuple(sys.path)) if self._group else {}), **self._targets}

    def __iter__(self) -> Iterator[str]:
        return iter(self.targets())

    def module(self, name: str) -> str:
        """Dotted name of the module that defines a name's object; nothing is imported.

        Raises:
            HarnessError: as ``resolve``.
        """
        return EntryPoint(name=name, value=self._target(name), group=self._group).module

    def resolve(self, name: str) -> Any:
        """The object behind a name.

        Raises:
            HarnessError: an unknown name, with the nearest known one as a hint; or a module
                without the object.
            MissingPart: the module needs a package that is not installed.
        """
        target = self._target(name)
        try:
            return EntryPoint(name=name, value=target, group=self._group).load()
        except ImportError as error:
            raise explained(error, f"{self.kind} '{name}'") or MissingPart(
                f"{self.kind} '{name}' could not be loaded: {error}",
                hint="Run 'harness doctor' to see what is missing and how to install it",
            ) from error
        except AttributeError as error:
            raise HarnessError(
                f"{self.kind} '{name}' is not where it is registered",
                expected=target,
                got=str(error),
            ) from error

    def _target(self, name: str) -> str:
        targets = self.targets()
        if name not in targets:
            raise HarnessError(f"unknown {self.kind} '{name}'", hint=did_you_mean(name, targets))
        return targets[name]


@functools.cache
def _found(group: str, _paths: tuple[str, ...]) -> dict[str, str]:
    """Third parties' targets by name: going through what is installed takes milliseconds."""
    return {point.name: point.value for point in entry_points(group=group)}


@runtime_checkable
class Installable(Protocol):
    """Knows whether it can run on this machine before it is run."""

    def require_installed(self) -> None:
        """Nothing, if it can.

        Raises:
            MissingPart: something is not installed; the hint is the next command.
            MethodError: this machine cannot hold it.
        """
        ...
