"""``method.toml``: how a worker is called, and what its interpreter has to have.

    name = "vggt"
    command = ["{python}", "{start}", "{parent}", "{script}", "{request}", "{answer}"]
    script = "worker.py"
    modules = ["torch", "vggt.models.vggt"]
    install = "git clone https://... && pip install -r requirements.txt"
    licence = "VGGT License"

The words in braces are filled in for each call. A container or another launcher goes before them.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from harness.core.errors import DataError

__all__ = ["MANIFEST", "Worker", "read_worker"]

MANIFEST = "method.toml"
#: What a command may have filled in.
WORDS = ("python", "start", "parent", "script", "request", "answer")
_COMMAND = ("{python}", "{start}", "{parent}", "{script}", "{request}", "{answer}")


@dataclass(frozen=True, slots=True)
class Worker:
    """One worker.

    Attributes:
        name: What it is called in messages.
        folder: Where its ``method.toml`` lies.
        script: The one file that runs, in that folder.
        modules: What has to be importable; the digest of the last one's package is recorded.
        install: How the user gets these.
        licence: Licence of the last module's package.
        command: Its words.
    """

    name: str
    folder: Path
    script: str
    modules: tuple[str, ...]
    install: str
    licence: str
    command: tuple[str, ...] = _COMMAND

    @property
    def script_path(self) -> Path:
        """The file that runs."""
        return self.folder / self.script

    def words(self, filled: Mapping[str, str]) -> list[str]:
        """The command with the words in braces filled in."""
        found: list[str] = []
        for word in self.command:
            for name, text in filled.items():
                word = word.replace(f"{{{name}}}", text)
            found.append(word)
        return found


def read_worker(folder: Path) -> Worker:
    """The worker that a folder's ``method.toml`` describes.

    Raises:
        DataError: no such file, not TOML, or entries that are missing, unknown or of another type.
    """
    path = folder / MANIFEST
    try:
        entries = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise DataError(f"{path} is not TOML: {error}") from error
    known = {each.name for each in fields(Worker)} - {"folder"}
    needed = known - {"command"}
    if set(entries) - known or needed - set(entries):
        raise DataError(
            f"{path} is not a description of a worker",
            expected=", ".join(sorted(known)),
            got=", ".join(sorted(entries)) or "nothing",
        )
    worker = Worker(
        name=_text(path, "name", entries["name"]),
        folder=folder,
        script=_text(path, "script", entries["script"]),
        modules=_texts(path, "modules", entries["modules"]),
        install=_text(path, "install", entries["install"]),
        licence=_text(path, "licence", entries["licence"]),
        command=_texts(path, "command", entries.get("command", list(_COMMAND))),
    )
    _check_command(path, worker)
    return worker


def _check_command(path: Path, worker: Worker) -> None:
    if not worker.script_path.is_file():
        raise DataError(f"{path} names a script that is not there", got=worker.script)
    left = worker.words(dict.fromkeys(WORDS, ""))
    if any("{" in word for word in left):
        raise DataError(
            f"{path} has a command with unknown words",
            expected=", ".join(f"{{{word}}}" for word in WORDS),
            got=" ".join(worker.command),
        )
    for needed in ("{request}", "{answer}"):
        if not any(needed in word for word in worker.command):
            raise DataError(f"the command in {path} does not take {needed}")


def _text(path: Path, name: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise DataError(f"'{name}' in {path} is not a text", got=repr(value))
    return value


def _texts(path: Path, name: str, value: object) -> tuple[str, ...]:
    if not isinstance(value, list) or not value:
        raise DataError(f"'{name}' in {path} is not a list of texts", got=repr(value))
    return tuple(_text(path, name, each) for each in value)
