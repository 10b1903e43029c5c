"""The methods that a user added to a workspace: names, and where their ``method.toml`` lie.

A method stays where it is. Its files and its environment count in the key of each of its records,
so that a change of either makes these stale.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.atomic import exclusive_lock, read_json, write_json
from harness.run.workspace import Workspace
from methods.catalog import METHODS
from methods.foreign.command_method import CommandMethod
from methods.foreign.method_file import METHOD_FILE, read_method

ADDED_FILE = "added_methods.json"
#: In which all of them are; what differs between them are their parts.
ADDED_MODULE = CommandMethod.__module__
_SCHEMA = 1


@dataclass(frozen=True, slots=True)
class AddedMethods:
    """The methods that were added to a workspace.

    Attributes:
        root: The workspace's folder.
    """

    root: Path

    @classmethod
    def of(cls, workspace: Workspace) -> AddedMethods:
        """Those of a workspace."""
        return cls(workspace.root)

    @property
    def path(self) -> Path:
        """The file that lists them."""
        return self.root / ADDED_FILE

    def names(self) -> tuple[str, ...]:
        """Their names, in the order in which they were added.

        Raises:
            DataError: the list cannot be read.
        """
        return tuple(self._listed())

    def folder(self, name: str) -> Path:
        """Where a method lies.

        Raises:
            HarnessError: none of this name was added.
        """
        listed = self._listed()
        if name not in listed:
            raise HarnessError(
                f"no method '{name}' was added to {self.root}", hint=did_you_mean(name, listed)
            )
        return self.root / listed[name]

    def method(self, name: str) -> CommandMethod:
        """A method as its ``method.toml`` describes it now.

        Raises:
            HarnessError: none of this name was added, or its file has another name in it now.
            DataError: its file cannot be read.
        """
        method = CommandMethod(read_method(self.folder(name)))
        if method.file.name != name:
            raise HarnessError(
                f"{method.file.path} describes another method now",
                expected=name,
                got=method.file.name,
                hint=f"Run: harness methods remove {name}, and add it again",
            )
        return method

    def add(self, path: Path) -> CommandMethod:
        """The method of a ``method.toml``, which is in the list from now on.

        Raises:
            HarnessError: its name is that of another method.
            DataError: its file cannot be read.
            MissingPart: its environment does not run.
        """
        method = CommandMethod(read_method(path.resolve()))
        name, folder = method.file.name, method.file.folder
        if name in METHODS:
            raise HarnessError(
                f"'{name}' is a method of the catalogue",
                hint=f"Give it another name in {method.file.path}",
            )
        _ = method.info  # its environment runs
        with exclusive_lock(self.path.with_suffix(".lock")):
            listed = self._listed()
            if name in listed and (self.root / listed[name]) != folder:
                raise HarnessError(
                    f"another method '{name}' was added before",
                    got=str(self.root / listed[name]),
                    hint=f"Run: harness methods remove {name}",
                )
            inside = folder.is_relative_to(self.root)
            place = folder.relative_to(self.root).as_posix() if inside else str(folder)
            self._write({**listed, name: place})
        return method

    def remove(self, name: str) -> Path:
        """Take a method from the list; its folder, which is returned, and its records stay.

        Raises:
            HarnessError: none of this name was added.
        """
        with exclusive_lock(self.path.with_suffix(".lock")):
            folder = self.folder(name)
            self._write({known: at for known, at in self._listed().items() if known != name})
        return folder

    def _listed(self) -> dict[str, str]:
        if not self.path.is_file():
            return {}
        document = read_json(self.path)
        found: Mapping[str, str] | None = document.get("methods")
        if document.get("schema") != _SCHEMA or not isinstance(found, dict):
            raise DataError(
                f"{self.path} is no list of methods of this version",
                hint=f"Delete it, and add the methods again by their {METHOD_FILE}",
            )
        return dict(found)

    def _write(self, listed: Mapping[str, str]) -> None:
        write_json(self.path, {"schema": _SCHEMA, "methods": dict(listed)})
