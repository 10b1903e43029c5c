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
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import TypeVar

from harness.core.errors import DataError
from harness.core.files.reach import named_path
from harness.core.formats.typed_json import from_json, to_json

T = TypeVar("T")
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
        """The file that runs, which lies in the folder."""
        return named_path(self.folder / MANIFEST, self.script)

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
    worker = read_described(Worker, path, "a description of a worker")
    _check_command(path, worker)
    return worker


def read_described(kind: type[T], path: Path, noun: str) -> T:
    """What a TOML file describes: a dataclass whose ``folder`` is that of the file.

    Raises:
        DataError: no such file, not TOML, or entries that are missing, unknown or of another type.
    """
    try:
        entries = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path} is not TOML: {error}") from error
    if "folder" in entries:
        raise DataError(f"{path} is not {noun}", got="an entry 'folder'")
    left: dict[str, object] = {"folder": str(path.parent)}
    for each in fields(kind):  # pyright: ignore[reportArgumentType]
        if each.default is not MISSING:
            left[each.name] = to_json(each.default)
        elif each.default_factory is not MISSING:
            left[each.name] = to_json(each.default_factory())
    return from_json(kind, {**left, **entries}, path, noun)


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
