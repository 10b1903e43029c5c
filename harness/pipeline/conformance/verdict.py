"""What a method was asked and what came out, as people and programs read it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from harness.core.files.atomic import write_json
from harness.core.formats.typed_json import to_json
from harness.core.records import Environment

_SCHEMA = 1

Answer = Literal["yes", "no", "not asked"]

#: What is asked, in order.
CHECKS: Mapping[str, str] = {
    "environment": "Its environment runs, and it describes itself",
    "runs": "It makes a mesh of one subject",
    "metres": "The mesh is in metres",
    "place": "The mesh stands where the subject stands",
    "up": "+Y is up",
    "facing": "The subject faces +Z",
    "handedness": "Left is not right",
    "winding": "Faces are wound outward",
    "watertight": "The surface is closed",
    "repeats": "The same seed gives the same mesh",
    "deterministic": "Another seed changes nothing, as it says",
    "declared_views": "Photos that it does not declare change nothing",
    "renamed": "Other names and another folder change nothing",
    "leaves_nothing": "No process of it stays, even when it is killed",
    "cost": "It stays within the time and the memory that were allowed",
}


@dataclass(frozen=True, slots=True)
class Check:
    """One question.

    Attributes:
        id: A key of ``CHECKS``.
        answer: ``not asked`` where it makes no sense, or an earlier answer left nothing to ask.
        text: What was found, in a few words.
    """

    id: str
    answer: Answer
    text: str

    @property
    def line(self) -> str:
        """One line for people."""
        mark = {"yes": "ok", "no": "FAILED", "not asked": "-"}[self.answer]
        return f"{mark:7} {CHECKS[self.id]}: {self.text}"


@dataclass(frozen=True, slots=True)
class Certificate:
    """What ``harness conform`` found.

    Attributes:
        method: Its name.
        title: Its title.
        checks: All questions, in the order of ``CHECKS``.
        identity: ``MethodInfo.identity()``; empty where it could not say.
        environment_sha256: Content id of its code, files, packages and interpreter; likewise.
        dataset, subject, recipe, photos: What it was tried on; the last is the capture's key.
        seed: The seed of the trials.
        harness: Where and with what it was tried.
        created_utc: When, ISO 8601.
    """

    method: str
    title: str
    checks: tuple[Check, ...]
    identity: Mapping[str, object] = field(default_factory=dict[str, object])
    environment_sha256: str = ""
    dataset: str = ""
    subject: str = ""
    recipe: str = ""
    photos: str = ""
    seed: int = 0
    harness: Environment | None = None
    created_utc: str = ""

    @property
    def conforms(self) -> bool:
        """Whether no answer is no."""
        return not self.failed

    @property
    def failed(self) -> tuple[str, ...]:
        """The ids of questions whose answer is no."""
        return tuple(check.id for check in self.checks if check.answer == "no")

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, with the verdict first."""
        return {"schema": _SCHEMA, "conforms": self.conforms, **to_json(self)}

    def save(self, path: Path) -> None:
        """Write it atomically."""
        write_json(path, self.to_dict())
