"""A method of the catalogue with the settings that a request gives it, resolved once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any

from harness.core.errors import HarnessError, did_you_mean
from harness.core.files.names import checked_name, suffix_of
from harness.core.missing import METHOD_EXTRAS, absent_extras, not_installed
from harness.core.process.registry import Installable
from harness.core.process.source_digest import SourceTree
from harness.core.protocols import Configurable, Method, MethodInfo
from harness.run.added_methods import ADDED_MODULE, AddedMethods
from harness.run.workspace import Workspace
from methods.catalog import METHODS

OPEN, PAPER = "open", "paper"


@dataclass(frozen=True, slots=True)
class _Exchange:
    """A setting and its values with the open part and with the paper's."""

    setting: str
    open: str
    paper: str


#: By the name of the part: what it is called among open parts and among the paper's, and the
#: settings that it decides.
_PARTS: dict[str, tuple[str, str, tuple[_Exchange, ...]]] = {
    "body": ("anny", "smplx", (_Exchange("body.model", "anny", "smplx"),)),
    "start": ("landmarks", "pixie", (_Exchange("body.start", "average", "pixie"),)),
    "normals": (
        "open",
        "econ",
        tuple(
            _Exchange(f"{room}.normals", "open", "econ") for room in ("body", "surface", "nview")
        ),
    ),
    "completion": ("body", "ifnet", (_Exchange("surface.completion", "body", "ifnet"),)),
}


@dataclass(frozen=True, slots=True)
class PartChoice:
    """The parts that were chosen.

    Attributes:
        papers: Names of the parts for which the paper's own is used.
    """

    papers: frozenset[str] = frozenset()

    def settings(self, info: MethodInfo) -> dict[str, str]:
        """What a method's settings have to be changed to, as text by name."""
        exchanges = [each for name in sorted(self.papers) for each in _PARTS[name][2]]
        return {each.setting: each.paper for each in exchanges if _uses(info, each)}


def _uses(info: MethodInfo, exchange: _Exchange) -> bool:
    """Whether a method uses the open part."""
    room, _, name = exchange.setting.partition(".")
    own = info.parameters.get(room, {})
    # A fit that ends with the first bodies has no start to go on from, but PIXIE may make them.
    value = own.get(name, "average" if name == "start" and "stage" in own else None)
    return value == exchange.open


def parsed_parts(text: str) -> PartChoice:
    """The choice behind ``--parts``.

    Args:
        text: ``open``, ``paper``, or pairs such as ``normals=econ,body=smplx``; parts that are not
            named are open.

    Raises:
        HarnessError: a part or a name that is not known.
    """
    if text in ("", OPEN):
        return PartChoice()
    if text == PAPER:
        return PartChoice(frozenset(_PARTS))
    return PartChoice(frozenset(filter(None, map(_paper_part, text.split(",")))))


def _paper_part(pair: str) -> str:
    """The name of the part that a pair chooses the paper's own of; empty for an open one."""
    key, separator, name = (word.strip() for word in pair.partition("="))
    if not separator or key not in _PARTS:
        raise HarnessError(
            f"--parts {pair}",
            expected="open, paper, or pairs such as normals=econ",
            hint=did_you_mean(key, [OPEN, PAPER, *_PARTS]),
        )
    open_name, paper_name, _ = _PARTS[key]
    if name not in (open_name, paper_name):
        raise HarnessError(f"--parts {pair}", expected=f"{key}={open_name} or {key}={paper_name}")
    return key if name == paper_name else ""


@dataclass(frozen=True, slots=True)
class MethodRef:
    """A method by name, as it travels to other processes.

    Attributes:
        name: In the catalogue, or among the methods that were added.
        settings: As text by name.
        row: What its records are called; empty for its name.
    """

    name: str
    settings: Mapping[str, str]
    row: str = ""

    def found(self, workspace: Workspace) -> ChosenMethod:
        """The method itself, in this process.

        Raises:
            HarnessError, MissingPart: as ``ChosenMethod.of``.
        """
        added = AddedMethods.of(workspace)
        return ChosenMethod.of(self.name, self.settings, self.row, added=added)


@dataclass(frozen=True, slots=True, eq=False)
class ChosenMethod:
    """A method that is known to be usable here.

    Attributes:
        row: What its records and its rows in tables are called: its name in the catalogue, unless
            other settings got a name of their own.
        name: Its name in the catalogue.
        settings: The settings that differ from their defaults, as text by name.
        module: Dotted name of the module in which the catalogue has it.
        method: The method itself, with these settings.
    """

    row: str
    name: str
    settings: Mapping[str, str]
    module: str
    method: Method

    @classmethod
    def of(
        cls,
        name: str,
        settings: Mapping[str, str],
        row: str = "",
        parts: PartChoice | None = None,
        added: AddedMethods | None = None,
    ) -> ChosenMethod:
        """The method of a name, with some settings changed.

        Args:
            name: In the catalogue, or among the methods that were added.
            settings: As text by name; they count more than the parts.
            row: What its records are called, if not by its name.
            parts: Parts that a user chose; None leaves the method its own.
            added: Those of a workspace; None for none.

        Raises:
            HarnessError: an unknown method or setting, settings for a method that has none, or a
                row that has the name of another method, or no settings of its own.
            MissingPart: the method, or one of its parts, is not installed.
        """
        method: Method
        method, module = _found(name, added)
        if parts is not None and parts.papers:
            settings = {**parts.settings(method.info), **settings}
        if settings:
            if not isinstance(method, Configurable):
                raise HarnessError(
                    f"method '{name}' has no settings",
                    got=", ".join(settings),
                    hint="Leave --set out",
                )
            method = method.configured(settings)
        if row:
            _check_row(row, settings, added)
        chosen = cls(row or name, name, dict(settings), module, method)
        # Asking for the parts finds missing ones now, and not after photos have been made.
        if method.info.name != name:
            raise HarnessError(
                f"method '{name}' calls itself '{method.info.name}'",
                hint="Register it under its own name",
            )
        return chosen

    @property
    def ref(self) -> MethodRef:
        """What it is found by again."""
        return MethodRef(self.name, self.settings, "" if self.row == self.name else self.row)

    @property
    def info(self) -> MethodInfo:
        """The method's own description, under the row's name; it follows changes of its parts."""
        info = self.method.info
        if self.row == self.name:
            return info
        # A title goes into tables: of a file on this machine, only its name.
        changed = [
            f"{name}={PurePath(value).name if value.startswith('/') else value}"
            for name, value in sorted(self.settings.items())
        ]
        told = [suffix.strip("-").replace("-", " ")] if (suffix := suffix_of(self.row)) else []
        return replace(info, name=self.row, title=", ".join((info.title, *told, *changed)))

    def require_installed(self) -> None:
        """Nothing, if the method can run here.

        Raises:
            MissingPart: it runs on something that is not installed; the hint is the next command.
            MethodError: this machine has too little memory for it.
        """
        if absent := absent_extras(METHOD_EXTRAS):
            used = SourceTree.installed(self.module).digest([self.module]).packages
            if lacking := [name for name in absent if name in used]:
                raise not_installed(lacking[0], f"method '{self.name}'")
        if isinstance(self.method, Installable):
            self.method.require_installed()


def _found(name: str, added: AddedMethods | None) -> tuple[Any, str]:
    """A method and the module that it is in; the catalogue comes first."""
    known = added.names() if added else ()
    if name in METHODS:
        return METHODS.resolve(name), METHODS.module(name)
    if added and name in known:
        return added.method(name), ADDED_MODULE
    raise HarnessError(f"unknown method '{name}'", hint=did_you_mean(name, [*METHODS, *known]))


def _check_row(row: str, settings: Mapping[str, str], added: AddedMethods | None) -> None:
    checked_name("row", row)
    if row in METHODS or (added and row in added.names()):
        raise HarnessError(
            f"a row cannot be called '{row}'",
            expected="a name that no method has",
            hint="Choose another name for --as",
        )
    if not settings and not suffix_of(row):
        raise HarnessError(
            f"row '{row}' is a method with other settings, and none is given",
            hint="Give --set NAME=VALUE, or leave --as out",
        )


def chosen_methods(
    names: Sequence[str],
    settings: Mapping[str, str],
    row: str = "",
    parts: PartChoice | None = None,
    added: AddedMethods | None = None,
    suffix: str = "",
) -> tuple[ChosenMethod, ...]:
    """The methods of some names, all with the same settings, ready to run.

    Args:
        names: In the catalogue, or among the methods that were added.
        settings: What a user set, as text by name; it counts more than the parts.
        row: What the records of the only method are called, if not by its name.
        parts: Parts that a user chose; None leaves each method its own.
        added: Those of a workspace; None for none.
        suffix: What is added to the name of each row that has none of its own.

    Raises:
        HarnessError: several methods for one row, or as ``ChosenMethod.of`` and
            ``ChosenMethod.require_installed``.
    """
    if row and len(names) != 1:
        raise HarnessError(
            f"row '{row}' can be of one method only", got=", ".join(names), hint="Run one at a time"
        )
    chosen: list[ChosenMethod] = []
    for name in names:
        own = row or (name + suffix if suffix else "")
        method = ChosenMethod.of(name, settings, own, parts, added)
        method.require_installed()
        chosen.append(method)
    return tuple(chosen)


@dataclass(frozen=True, slots=True, eq=False)
class Catalogued:
    """All methods that can be named, third parties' included, with their default settings.

    Attributes:
        usable: The methods that describe themselves here, in the catalogue's order.
        failures: Why others cannot be used, by name.
        missing: Why some of the usable ones cannot run yet, by name: something that the user
            installs is missing, or this machine has too little memory.
    """

    usable: tuple[ChosenMethod, ...]
    failures: Mapping[str, HarnessError]
    missing: Mapping[str, HarnessError]


def catalogued_methods(added: AddedMethods | None = None) -> Catalogued:
    """Every method of the catalogue, and those added, or the reason why it cannot be used."""
    usable: list[ChosenMethod] = []
    failures: dict[str, HarnessError] = {}
    missing: dict[str, HarnessError] = {}
    for name in (*METHODS, *(added.names() if added else ())):
        try:
            usable.append(ChosenMethod.of(name, {}, added=added))
        except HarnessError as error:
            failures[name] = error
            continue
        try:
            usable[-1].require_installed()
        except HarnessError as error:
            missing[name] = error
    return Catalogued(tuple(usable), failures, missing)
