"""A method of the catalogue with the settings that a request gives it, resolved once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from harness.core.errors import HarnessError
from harness.core.protocols import Configurable, Method, MethodInfo
from methods.catalog import METHODS

__all__ = ["Catalogued", "ChosenMethod", "catalogued_methods", "chosen_methods"]


@dataclass(frozen=True, slots=True, eq=False)
class ChosenMethod:
    """A method that is known to be usable here.

    Attributes:
        name: Its name in the catalogue.
        settings: The settings that differ from their defaults, as text by name.
        module: Dotted name of the module in which the catalogue has it.
        method: The method itself, with these settings.
    """

    name: str
    settings: Mapping[str, str]
    module: str
    method: Method

    @classmethod
    def of(cls, name: str, settings: Mapping[str, str]) -> ChosenMethod:
        """The method of a name, with some settings changed.

        Raises:
            HarnessError: an unknown method or setting, or settings for a method that has none.
            MissingPart: the method, or one of its parts, is not installed.
        """
        method: Method = METHODS.resolve(name)
        if settings:
            if not isinstance(method, Configurable):
                raise HarnessError(
                    f"method '{name}' has no settings",
                    got=", ".join(settings),
                    hint="Leave --set out",
                )
            method = method.configured(settings)
        chosen = cls(name, dict(settings), METHODS.module(name), method)
        # Asking for the parts finds missing ones now, and not after photos have been made.
        if chosen.info.name != name:
            raise HarnessError(
                f"method '{name}' calls itself '{chosen.info.name}'",
                hint="Register it under its own name",
            )
        return chosen

    @property
    def info(self) -> MethodInfo:
        """What the method says of itself now; its parts are files, which may change."""
        return self.method.info


def chosen_methods(names: Iterable[str], settings: Mapping[str, str]) -> tuple[ChosenMethod, ...]:
    """The methods of some names, all with the same settings.

    Raises:
        HarnessError: as ``ChosenMethod.of``.
    """
    return tuple(ChosenMethod.of(name, settings) for name in names)


@dataclass(frozen=True, slots=True, eq=False)
class Catalogued:
    """All methods of the catalogue, third parties' included, with their default settings.

    Attributes:
        usable: The methods that can be used here, in the catalogue's order.
        failures: Why others cannot be used, by name.
    """

    usable: tuple[ChosenMethod, ...]
    failures: Mapping[str, HarnessError]


def catalogued_methods() -> Catalogued:
    """Every method of the catalogue, or the reason why it cannot be used."""
    usable: list[ChosenMethod] = []
    failures: dict[str, HarnessError] = {}
    for name in METHODS:
        try:
            usable.append(ChosenMethod.of(name, {}))
        except HarnessError as error:
            failures[name] = error
    return Catalogued(tuple(usable), failures)
