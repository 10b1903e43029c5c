"""What a kind of part is: its role and licence, how a file of it is imported, found and checked."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Protocol

from harness.core.errors import HarnessError, MissingPart
from harness.core.process.registry import Registry
from harness.core.protocols import Part


class State:
    """What a part's files can be."""

    OK = "ok"
    MISSING = "missing"
    CORRUPT = "corrupt"


@dataclass(frozen=True, slots=True)
class About:
    """A kind of part, as a person reads it.

    Attributes:
        name: What it is called in ``harness parts import NAME FILE``.
        role: What it is in a record, such as ``normal estimator``.
        purpose: What it is for, one sentence without its full stop.
        licence: The licence of the files.
        source: Where the files come from, and what has to be done to get them.
        files: Names that the files have there.
        takes: The names of those ``ImportOptions`` that an import of this kind understands;
            ``replace`` is for all.
    """

    name: str
    role: str
    purpose: str
    licence: str
    source: str
    files: tuple[str, ...]
    takes: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """What to run once a file is there."""
        return f"harness parts import {self.name} {self.files[0]}"

    def missing(self, got: str = "") -> MissingPart:
        """The error of a run that needs the part while there is none."""
        return MissingPart(
            f"no part '{self.name}' ({self.purpose}) is imported",
            expected=" or ".join(self.files),
            got=got,
            hint=f"{self.source}; then run: {self.command}",
        )

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {**asdict(self), "files": list(self.files), "takes": list(self.takes)}


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What a person may say about an import beside the file.

    Attributes:
        name: How the part will be asked for; empty chooses the kind's own.
        recipe: Which recipe makes the file usable.
        python: The interpreter of an environment that the part runs in.
        replace: Whether the part may take the place of another one of that name.
    """

    name: str = ""
    recipe: str = ""
    python: Path | None = None
    replace: bool = False

    def require_taken_by(self, about: About) -> None:
        """Refuse options that a kind does not understand.

        Raises:
            HarnessError: there is one.
        """
        silent = ImportOptions()
        for field in fields(self):
            given = getattr(self, field.name) != getattr(silent, field.name)
            if given and field.name not in (*about.takes, "replace"):
                known = ", ".join(f"--{name}" for name in (*about.takes, "replace"))
                raise HarnessError(
                    f"an import of '{about.name}' does not take --{field.name}", expected=known
                )


@dataclass(frozen=True, slots=True)
class InstalledPart:
    """A part that was imported, or that came with the package.

    Attributes:
        kind: Name of its kind.
        name: How it is asked for among those of its kind.
        title: What it is, as records name it.
        licence: The licence that it says it has, or its kind's.
        path: Its file or folder, which need not exist.
        bytes: Size of all its files.
        sha256: Digest of its files when they were written.
        source_sha256: Digest of the file that was imported.
        place: ``shipped`` or ``imported``.
        note: What else a person might want to know.
    """

    kind: str
    name: str
    title: str
    licence: str
    path: Path
    bytes: int
    sha256: str
    source_sha256: str
    place: str = "imported"
    note: str = ""

    @property
    def label(self) -> str:
        """What ``harness parts verify`` calls it."""
        return self.kind if self.name == self.kind else f"{self.kind}/{self.name}"

    def part(self, role: str) -> Part:
        """As records name it."""
        return Part(role, self.title, self.licence, self.sha256)

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {**asdict(self), "path": str(self.path)}


@dataclass(frozen=True, slots=True)
class PartCheck:
    """Whether a part's files are those that were written.

    Attributes:
        part: Which one.
        state: One of ``State``.
        note: What was found.
    """

    part: InstalledPart
    state: str
    note: str

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {**self.part.to_dict(), "state": self.state, "check": self.note}


class PartKind(Protocol):
    """A kind of part; ``methods/parts/kind.py`` lists them.

    Its module is imported to list the parts, so it imports nothing heavy at its top. Most kinds are
    a ``methods.parts.store.ConvertedKind``.
    """

    @property
    def about(self) -> About:
        """What it is."""
        ...

    def installed(self) -> Sequence[InstalledPart]:
        """The parts of this kind that are there; no file is hashed.

        Raises:
            DataError: what was noted about one is not right.
        """
        ...

    def add(self, file: Path, options: ImportOptions) -> InstalledPart:
        """The part in a file, checked, converted and written; nothing is changed on failure.

        Raises:
            DataError: the file is not one of this kind.
            HarnessError: options that do not go together, or another part has the name.
            MissingPart: what the conversion needs is not installed.
        """
        ...

    def check(self, part: InstalledPart) -> PartCheck:
        """A part against its digest; all its files are read anew."""
        ...

    def usage(self, part: InstalledPart) -> str:
        """The command that uses a part."""
        ...


KINDS = Registry(
    "kind of part",
    {
        "econ-normal": "methods.parts.converted:ECON_NORMALS",
        "ifnet": "methods.parts.converted:IFNET",
        "pixie": "methods.parts.converted:PIXIE",
        "smplx": "methods.body.models.smplx_part:SMPLX",
        "normals-onnx": "methods.normals.estimators:NETWORKS",
        "masks-onnx": "methods.masks:MASK_NETWORKS",
        "lpips": "methods.perceptual:LPIPS",
    },
)


def part_kind(name: str) -> PartKind:
    """The kind of a name.

    Raises:
        HarnessError: there is none, with the nearest one as a hint.
    """
    kind: PartKind = KINDS.resolve(name)
    return kind


def all_kinds() -> list[PartKind]:
    """Every kind, in the order in which a person would import them."""
    return [part_kind(name) for name in KINDS]
