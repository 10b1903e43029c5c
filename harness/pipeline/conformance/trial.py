"""One trial of a method, as it travels to the worker that carries it out, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.core.formats.typed_json import from_json, to_json
from harness.pipeline.inputs.sources import Source


@dataclass(frozen=True, slots=True)
class Trial:
    """What one trial is.

    Attributes:
        source: The dataset, with the subject alone.
        method: Name of the method.
        settings: Its settings that differ from the defaults.
        capture: Folder of the photos that it is given.
        seed: What it is given as a seed.
        folder: Receives the mesh.
    """

    source: Source
    method: str
    settings: Mapping[str, str]
    capture: Path
    seed: int
    folder: Path

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            "source": self.source.to_dict(),
            "method": self.method,
            "settings": dict(self.settings),
            "capture": str(self.capture),
            "seed": self.seed,
            "folder": str(self.folder),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Trial:
        """The trial behind ``to_dict``."""
        return cls(
            Source.from_dict(values["source"]),
            values["method"],
            values["settings"],
            Path(values["capture"]),
            values["seed"],
            Path(values["folder"]),
        )


@dataclass(frozen=True, slots=True)
class TrialResult:
    """How a trial ended that was not killed.

    Attributes:
        reason: Why there is no mesh; empty where there is one.
        mesh: Its file; empty where there is none.
        before_s: From the worker's start until the method was called, seconds.
        wall_s: How long the method took, seconds.
        peak_rss_mib: The most memory that it used, with its children, MiB.
    """

    reason: str = ""
    mesh: str = ""
    before_s: float = 0.0
    wall_s: float = 0.0
    peak_rss_mib: float = 0.0

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return to_json(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, object]) -> TrialResult:
        """The result behind ``to_dict``."""
        return from_json(cls, values, "the worker's answer", "a trial's result")
