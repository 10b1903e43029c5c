"""Parts that are converted when they are imported: a folder for each, with a note of what it is.

``<parts folder>/<kind>/<name>/`` holds the converted files and ``part.json``: title, licence, the
imported file's name, size and sha256, and each converted file's. A part is compared with its sums
before it is used, once a process, so that a record's hash is that of what ran.
"""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Protocol

from harness.core.errors import DataError, HarnessError, MissingPart
from harness.core.files.atomic import (
    atomic_directory,
    exclusive_lock,
    read_json,
    write_json,
)
from harness.core.files.hashing import file_sha256
from harness.core.files.names import NAME_RULE, is_name
from harness.core.typed_json import from_json, to_json
from methods.parts.kind import About, ImportOptions, InstalledPart, PartCheck, State


def user_folder(variable: str, name: str) -> Path:
    """The folder that an environment variable names, or one of that name below the data folder.

    The data folder is ``mexecon-harness`` below ``XDG_DATA_HOME``, or below ``~/.local/share``.
    """
    named = os.environ.get(variable)
    if named:
        return Path(named).expanduser().resolve()
    data = Path(os.environ.get("XDG_DATA_HOME", ""))
    # Its specification says that a relative path there counts as none.
    base = data if data.is_absolute() else Path.home() / ".local" / "share"
    return base / "mexecon-harness" / name


def parts_folder() -> Path:
    """The folder of converted parts: ``HARNESS_PARTS``, or ``parts`` below the data folder."""
    return user_folder("HARNESS_PARTS", "parts")


_NOTE = "part.json"


@dataclass(frozen=True, slots=True)
class Examined:
    """A file that was found to be of a kind.

    Attributes:
        name: How the part will be asked for unless the user names it.
        title: What it is, as records name it.
        write: Writes the converted files into an empty folder.
        details: What runs of it need to know, as text by name.
    """

    name: str
    title: str
    write: Callable[[Path], None]
    details: Mapping[str, str] = field(default_factory=dict[str, str])


class Examine(Protocol):
    """Reads a file that is said to be of a kind."""

    def __call__(self, file: Path, options: ImportOptions) -> Examined:
        """What is in a file; nothing is written yet.

        Raises:
            DataError: it is not of that kind.
            MissingPart: what reads it is not installed.
        """
        ...


@dataclass(frozen=True, slots=True)
class _File:
    """One file of a part, or the one that was imported."""

    name: str
    bytes: int
    sha256: str

    @classmethod
    def of(cls, path: Path) -> _File:
        return cls(path.name, path.stat().st_size, file_sha256(path))


@dataclass(frozen=True, slots=True)
class _Note:
    """What ``part.json`` holds."""

    kind: str
    name: str
    title: str
    licence: str
    source: _File
    files: tuple[_File, ...]
    details: Mapping[str, str]

    @property
    def sha256(self) -> str:
        """One digest for all that a part consists of."""
        if len(self.files) == 1 and not self.details:
            return self.files[0].sha256
        lines = [f"{file.name} {file.sha256}" for file in self.files]
        lines += [f"{name}={text}" for name, text in sorted(self.details.items())]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class StoredPart:
    """A part whose files are what they were when it was imported.

    Attributes:
        installed: What it is.
        details: What its conversion noted.
    """

    installed: InstalledPart
    details: Mapping[str, str]

    def file(self, name: str) -> Path:
        """One of its files."""
        return self.installed.path / name


@dataclass(frozen=True, slots=True)
class ConvertedKind:
    """A kind of part whose files are converted once; see ``PartKind``.

    Attributes:
        about: What it is.
        examiner: ``"module:function"`` of an ``Examine``. It is imported when a file is: a
            conversion needs PyTorch, and its code need not count where its result is used.
        uses: The command that uses a part, with ``{name}`` for the part's.
        preferred: The part that is meant where there are several and none is named.
    """

    about: About
    examiner: str
    uses: str
    preferred: str = ""

    @property
    def folder(self) -> Path:
        """Where its parts are; it need not exist."""
        return parts_folder() / self.about.name

    def installed(self) -> Sequence[InstalledPart]:
        """The parts that are there, by name; see ``PartKind.installed``."""
        return [self._described(note) for note in self._notes()]

    def find(self, name: str = "") -> StoredPart:
        """A part whose files are what they were; they are read once a process.

        Args:
            name: Which one; empty is the only one, the preferred one, or the one that is called
                like its kind.

        Raises:
            MissingPart: there is none of that name, or one of its files is gone.
            DataError: a file is another one, or what was noted about it is not right.
        """
        notes = {note.name: note for note in self._notes()}
        if not name and len(notes) == 1:
            name = next(iter(notes))
        note = notes.get(name or self.preferred or self.about.name)
        if note is None:
            if notes and not name:
                raise MissingPart(
                    f"several parts '{self.about.name}' are imported, and none was named",
                    got=", ".join(notes),
                )
            raise self.about.missing(got=f"only {', '.join(notes)}" if notes else "")
        found = self._checked(note, _remembered_sum)
        if found.state == State.MISSING:
            raise MissingPart(found.note, hint=f"Run: {self.about.command} --replace")
        if found.state == State.CORRUPT:
            raise DataError(
                f"the part '{found.part.label}' is not the one that was imported",
                got=found.note,
                hint=f"Run: {self.about.command} --replace",
            )
        return StoredPart(found.part, note.details)

    def add(self, file: Path, options: ImportOptions) -> InstalledPart:
        """Convert a file and keep it; see ``PartKind.add``."""
        options.require_taken_by(self.about)
        require_file(file)
        source = _File.of(file)
        examined = self._examine()(file, options)
        name = options.name or examined.name
        if not is_name(name):
            raise HarnessError(f"a part cannot be called '{name}'", expected=NAME_RULE)
        with exclusive_lock(self.folder / ".lock"):
            self._require_free(name, source, replace=options.replace)
            with atomic_directory(self.folder / name) as folder:
                examined.write(folder)
                files = tuple(_File.of(path) for path in sorted(folder.iterdir()))
                if file_sha256(file) != source.sha256:
                    raise DataError(f"{file} changed while it was read", hint="Import it again")
                note = _Note(
                    kind=self.about.name,
                    name=name,
                    title=examined.title,
                    licence=self.about.licence,
                    source=source,
                    files=files,
                    details=dict(examined.details),
                )
                write_json(folder / _NOTE, to_json(note))
        return self._described(note)

    def check(self, part: InstalledPart) -> PartCheck:
        """A part against its sums; see ``PartKind.check``."""
        return self._checked(self._note(part.path / _NOTE), file_sha256)

    def usage(self, part: InstalledPart) -> str:
        """The command that uses a part."""
        return self.uses.format(name=part.name)

    def _examine(self) -> Examine:
        try:
            found: Examine = EntryPoint(name="", value=self.examiner, group="").load()
        except ImportError as error:
            raise MissingPart(
                f"what imports '{self.about.name}' could not be loaded: {error}",
                hint="Run 'harness doctor' to see what is missing and how to install it",
            ) from error
        return found

    def _require_free(self, name: str, source: _File, *, replace: bool) -> None:
        before = {note.name: note for note in self._notes()}.get(name)
        if before and before.source.sha256 != source.sha256 and not replace:
            raise HarnessError(
                f"'{name}' was imported from another file already",
                expected=f"sha256 {before.source.sha256[:12]}…",
                got=f"{source.sha256[:12]}…",
                hint="Say --replace to put this one in its place",
            )

    def _notes(self) -> list[_Note]:
        # A folder that is being made, or that a killed import left, is no part.
        found = (path for path in self.folder.glob(f"*/{_NOTE}") if is_name(path.parent.name))
        return [self._note(path) for path in sorted(found)]

    def _note(self, path: Path) -> _Note:
        note = from_json(_Note, read_json(path), path, "a note of an imported part")
        names = [path.parent.name, *(file.name for file in note.files)]
        if note.name != names[0] or not all(map(is_name, names)):
            raise DataError(f"{path} is not the note of what is beside it", got=note.name)
        return note

    def _described(self, note: _Note) -> InstalledPart:
        return InstalledPart(
            kind=note.kind,
            name=note.name,
            title=note.title,
            licence=note.licence,
            path=self.folder / note.name,
            bytes=sum(file.bytes for file in note.files),
            sha256=note.sha256,
            source_sha256=note.source.sha256,
            note=f"from {note.source.name}",
        )

    def _checked(self, note: _Note, sum_of: Callable[[Path], str]) -> PartCheck:
        part = self._described(note)
        for file in note.files:
            path = part.path / file.name
            if not path.is_file():
                return PartCheck(part, State.MISSING, f"no file at {path}")
            size = path.stat().st_size
            if size != file.bytes:
                text = f"{file.name}: {size} bytes, expected {file.bytes}"
                return PartCheck(part, State.CORRUPT, text)
            found = sum_of(path)
            if found != file.sha256:
                text = f"{file.name}: sha256 {found[:12]}…, expected {file.sha256[:12]}…"
                return PartCheck(part, State.CORRUPT, text)
        return PartCheck(part, State.OK, "sha256 agrees")


def require_file(file: Path) -> None:
    """Refuse what is no file, or an empty one.

    Raises:
        DataError: it is.
    """
    if not file.is_file():
        raise DataError(f"no file at {file}")
    if file.stat().st_size == 0:
        raise DataError(f"{file} is empty", hint="The download did not work: get it again")


def _remembered_sum(path: Path) -> str:
    found = path.stat()
    return _sum(path, found.st_mtime_ns, found.st_size)


@functools.lru_cache
def _sum(path: Path, _changed_ns: int, _size: int) -> str:
    return file_sha256(path)
