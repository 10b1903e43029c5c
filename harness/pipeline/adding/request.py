"""What ``harness data add`` was asked for, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from harness.pipeline.inputs.workspace import Workspace

#: Not a licence that lets anybody pass data on, so that pages refuse to show scans under it.
UNSTATED_LICENCE = "not stated: pass on no scans, photos or meshes"


@dataclass(frozen=True, slots=True)
class AddRequest:
    """A folder and how it is to be read; empty texts were not given.

    Attributes:
        name: Of the dataset.
        folder: With scans or captures.
        workspace: Where converted scans and copied captures go.
        manifest: The file to be written; None takes the current folder's.
        subjects: Only these; all if empty.
        scale: ``metres``, ``cm``, ``mm``, ``height=<metres>``, ``units`` or ``fit``.
        facing: An axis such as ``+z``, degrees, ``id=degrees`` for each, or ``fit``.
        up: The axis of the files that points up, such as ``+z``.
        title: Name in tables; the dataset's name if empty.
        licence: Of the scans; ``UNSTATED_LICENCE`` if empty.
        grey: Whether scans without colours are made grey.
        copy: Whether a tree is converted instead of read where it lies.
        drop_hidden: Whether layers that no outside ray reaches are left out.
        replace: Whether an entry that was written by this command is replaced.
        skip_bad: Whether subjects that fail are left out.
    """

    name: str
    folder: Path
    workspace: Workspace
    manifest: Path | None = None
    subjects: tuple[str, ...] = ()
    scale: str = ""
    facing: str = ""
    up: str = ""
    title: str = ""
    licence: str = ""
    grey: bool = False
    copy: bool = False
    drop_hidden: bool = False
    replace: bool = False
    skip_bad: bool = False


@dataclass(frozen=True, slots=True)
class CheckedSubject:
    """How a subject's check ended.

    Attributes:
        subject: Its id.
        note: What it is, in words.
        warnings: What is out of the ordinary.
        failure: Why it cannot be used, in one sentence; empty if it can.
    """

    subject: str
    note: str = ""
    warnings: tuple[str, ...] = ()
    failure: str = ""


@dataclass(frozen=True, slots=True)
class Added:
    """What came of it.

    Attributes:
        name: Of the dataset.
        layout: What the folder looks like, in words.
        kind: The dataset's kind in the manifest.
        root: Its folder there.
        rules: The rules of scale and facing in words.
        subjects: How the check of each ended.
        manifest: The file.
        created: Whether the file is new, a copy of the installed one.
        written: Whether the entry was written.
    """

    name: str
    layout: str
    kind: str
    root: str
    rules: str
    subjects: tuple[CheckedSubject, ...]
    manifest: Path
    created: bool
    written: bool

    @property
    def failed(self) -> tuple[CheckedSubject, ...]:
        """The subjects that cannot be used."""
        return tuple(each for each in self.subjects if each.failure)
