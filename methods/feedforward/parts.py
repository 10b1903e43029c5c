"""Networks that a user brings: weights, checked and kept, and the Python that runs them.

``<parts folder>/<name>/`` holds the weights and ``network.json``: title, licence, the size and
sha256 of each file, and the interpreter.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError, HarnessError, MissingPart
from harness.core.files.atomic import atomic_directory, exclusive_lock, read_json, write_json
from harness.core.files.hashing import file_sha256
from harness.core.protocols import Part
from harness.core.typed_json import from_json, to_json
from methods.feedforward.checkpoint import WEIGHTS_FILE, examined_weights
from methods.foreign.interpreter import Interpreter, Packages
from methods.foreign.method_file import Worker, read_worker
from methods.parts.kind import About, ImportOptions, InstalledPart, PartCheck, State
from methods.parts.store import parts_folder


@dataclass(frozen=True, slots=True)
class InstalledNetwork:
    """Weights and an interpreter.

    Attributes:
        title: What the weights are, as records name them.
        licence: The weights' licence.
        sha256: Digest of the weights.
        weights: Their file or folder, as the worker takes it.
        bytes: Their size.
        interpreter: Which Python runs the worker.
    """

    title: str
    licence: str
    sha256: str
    weights: Path
    bytes: int
    interpreter: Interpreter

    def parts(self, worker: Worker) -> tuple[Part, ...]:
        """Weights and package, as records name them.

        Raises:
            MissingPart: the interpreter lacks what the worker needs.
        """
        package: Packages = self.interpreter.packages(worker)
        name = f"{worker.name} ({package.text})"
        return (
            Part("network", self.title, self.licence, self.sha256),
            Part("package", name, worker.licence, package.sha256),
        )


#: Gives the installed network, or raises ``MissingPart`` with the command that installs it.
Find = Callable[[], InstalledNetwork]


_NOTE = "network.json"
_SNAPSHOT = ("config.json", "model.safetensors")
_WORKERS = Path(__file__).resolve().parent / "workers"

#: Checks what a user has and returns what writes the files that are kept.
Examine = Callable[[Path], Callable[[Path], None]]


@dataclass(frozen=True, slots=True)
class NotedFile:
    """A file as it was written: its size and sha256."""

    bytes: int
    sha256: str


@dataclass(frozen=True, slots=True)
class NetworkNote:
    """What ``network.json`` holds.

    Attributes:
        title: What the weights are.
        licence: The weights' licence.
        files: By name.
        python: The interpreter that runs the network; empty is the harness's own.
    """

    title: str
    licence: str
    files: Mapping[str, NotedFile]
    python: str

    @property
    def bytes(self) -> int:
        """Size of all files."""
        return sum(file.bytes for file in self.files.values())

    @property
    def sha256(self) -> str:
        """One digest for all files."""
        lines = [f"{name} {file.sha256}" for name, file in sorted(self.files.items())]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class NetworkPart:
    """A network that a user may bring.

    Attributes:
        name: What it is called in ``harness parts import NAME``.
        title: What its weights are.
        licence: The weights' licence.
        source: Where they come from.
        files: What the user names, such as ``model.pt``.
        weights: Name of what the worker takes, in the part's folder; empty is the folder.
        examine: Checks a file or folder.
    """

    name: str
    title: str
    licence: str
    source: str
    files: str
    weights: str
    examine: Examine

    @property
    def folder(self) -> Path:
        """Where it is kept; it need not exist."""
        return parts_folder() / self.name

    @property
    def command(self) -> str:
        """What to run once the files are there."""
        return f"harness parts import {self.name} {self.files}"

    def add(
        self, given: Path, python: Path | None = None, *, replace: bool = False
    ) -> InstalledNetwork:
        """Check the weights, keep what is used of them, and note the interpreter.

        Args:
            given: File or folder as it is published.
            python: The interpreter that runs the network; None is the harness's own.
            replace: Whether the part may take the place of another one.

        Raises:
            DataError: not such weights; nothing is changed then.
            HarnessError: there is one already, or no such interpreter.
            MissingPart: what reads the weights is not installed, or the interpreter lacks packages.
        """
        interpreter = _interpreter(python)
        interpreter.packages(read_worker(_WORKERS / self.name))
        write = self.examine(given)
        with exclusive_lock(parts_folder() / f".{self.name}.lock"):
            if self.folder.exists() and not replace:
                raise HarnessError(
                    f"the part '{self.name}' is imported already",
                    got=str(self.folder),
                    hint=f"Run: {self.command} --replace",
                )
            with atomic_directory(self.folder) as folder:
                write(folder)
                note = NetworkNote(
                    title=self.title,
                    licence=self.licence,
                    files={path.name: _noted(path) for path in sorted(folder.iterdir())},
                    python=str(python.absolute()) if python else "",
                )
                write_json(folder / _NOTE, to_json(note))
        return self.find()

    def note(self) -> NetworkNote | None:
        """What was noted when it was imported; None if it never was. No other file is looked at.

        Raises:
            DataError: the note is not right.
        """
        path = self.folder / _NOTE
        if not path.is_file():
            return None
        return from_json(NetworkNote, read_json(path), path, "a note of an imported network")

    def find(self) -> InstalledNetwork:
        """The network as it was noted; its files are there, and of their sizes.

        Raises:
            MissingPart: it was never imported, or its interpreter is gone; the hint is the next
                command.
            DataError: files are others than those that were written.
        """
        note = self.note()
        if note is None:
            raise MissingPart(
                f"the part '{self.name}' ({self.title}) is not imported",
                hint=f"Get it from {self.source}, then run: {self.command}",
            )
        for name, entry in note.files.items():
            path = self.folder / name
            if not path.is_file() or path.stat().st_size != entry.bytes:
                raise DataError(
                    f"{path} is not the file that was imported",
                    hint=f"Run: {self.command} --replace",
                )
        return InstalledNetwork(
            title=note.title,
            licence=note.licence,
            sha256=note.sha256,
            weights=self.folder / self.weights,
            bytes=note.bytes,
            interpreter=Interpreter(Path(note.python) if note.python else None),
        )


def _noted(path: Path) -> NotedFile:
    return NotedFile(path.stat().st_size, file_sha256(path))


def _interpreter(python: Path | None) -> Interpreter:
    if python is not None and not python.is_file():
        raise HarnessError(
            f"no interpreter at {python}",
            expected="a Python program, such as vggt/bin/python",
            hint="Give it with --python",
        )
    return Interpreter(python.absolute() if python else None)


def _vggt(given: Path) -> Callable[[Path], None]:
    return examined_weights(given).write


def _snapshot(given: Path) -> Callable[[Path], None]:
    """A folder as ``huggingface-cli download`` leaves it: what ``from_pretrained`` takes."""
    missing = [name for name in _SNAPSHOT if not (given / name).is_file()]
    if missing:
        raise DataError(
            f"{given} is not a folder of weights",
            expected=" and ".join(_SNAPSHOT),
            got=f"no {' and no '.join(missing)}",
        )

    def write(folder: Path) -> None:
        for name in _SNAPSHOT:
            shutil.copyfile(given / name, folder / name)

    return write


VGGT = NetworkPart(
    name="vggt",
    title="VGGT-1B (aggregator, camera head, depth head)",
    licence="CC-BY-NC-4.0, or VGGT License for the commercial checkpoint",
    source="huggingface.co/facebook/VGGT-1B",
    files="model.pt",
    weights=WEIGHTS_FILE,
    examine=_vggt,
)
DA3 = NetworkPart(
    name="da3",
    title="DA3-BASE",
    licence="Apache-2.0",
    source="huggingface.co/depth-anything/DA3-BASE",
    files="FOLDER --python da3/bin/python",
    weights="",
    examine=_snapshot,
)
MAPANYTHING = NetworkPart(
    name="mapanything",
    title="map-anything-apache",
    licence="Apache-2.0",
    source="huggingface.co/facebook/map-anything-apache",
    files="FOLDER --python mapanything/bin/python",
    weights="",
    examine=_snapshot,
)


def find_vggt() -> InstalledNetwork:
    """See ``NetworkPart.find``."""
    return VGGT.find()


def find_da3() -> InstalledNetwork:
    """See ``NetworkPart.find``."""
    return DA3.find()


def find_mapanything() -> InstalledNetwork:
    """See ``NetworkPart.find``."""
    return MAPANYTHING.find()


@dataclass(frozen=True, slots=True)
class NetworkKind:
    """One network; see ``PartKind``.

    Attributes:
        network: How it is imported and found.
        method: The method that it is for.
    """

    network: NetworkPart
    method: str

    @property
    def about(self) -> About:
        """What it is."""
        return About(
            name=self.network.name,
            role="network",
            purpose=f"depth and cameras from photos, for {self.method}",
            licence=self.network.licence,
            source=f"Get it from {self.network.source}",
            files=(self.network.files,),
            takes=("python",),
        )

    def installed(self) -> Sequence[InstalledPart]:
        """The network, if it was imported."""
        note = self.network.note()
        return [] if note is None else [self._described(note)]

    def add(self, file: Path, options: ImportOptions) -> InstalledPart:
        """Check the weights and keep them; ``file`` may be a folder as it is published."""
        options.require_taken_by(self.about)
        self.network.add(file, options.python, replace=options.replace)
        note = self.network.note()
        assert note is not None
        return self._described(note)

    def check(self, part: InstalledPart) -> PartCheck:
        """The files against their sums; all are read anew."""
        note = self.network.note()
        if note is None:
            raise MissingPart(
                f"the part '{part.label}' is gone", hint=f"Run: {self.network.command}"
            )
        for name, noted in note.files.items():
            path = part.path / name
            if not path.is_file():
                return PartCheck(part, State.MISSING, f"no file at {path}")
            if (found := file_sha256(path)) != noted.sha256:
                text = f"{name}: sha256 {found[:12]}…, expected {noted.sha256[:12]}…"
                return PartCheck(part, State.CORRUPT, text)
        return PartCheck(part, State.OK, "sha256 agrees")

    def usage(self, part: InstalledPart) -> str:  # noqa: ARG002
        """The command that uses it."""
        return f"harness eval --method {self.method}"

    def _described(self, note: NetworkNote) -> InstalledPart:
        return InstalledPart(
            kind=self.network.name,
            name=self.network.name,
            title=note.title,
            licence=note.licence,
            path=self.network.folder,
            bytes=note.bytes,
            sha256=note.sha256,
            source_sha256="",
            note=f"runs in {note.python}" if note.python else "",
        )


VGGT_KIND = NetworkKind(VGGT, "vggt8")
DA3_KIND = NetworkKind(DA3, "da3-8")
MAPANYTHING_KIND = NetworkKind(MAPANYTHING, "mapanything8")
