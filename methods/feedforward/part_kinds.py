"""Networks of points as kinds of parts: ``harness parts`` lists, imports and verifies them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import MissingPart
from harness.core.files.hashing import file_sha256
from methods.feedforward.parts import DA3, MAPANYTHING, VGGT, NetworkNote, NetworkPart
from methods.parts.kind import About, ImportOptions, InstalledPart, PartCheck, State


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
