"""One trial of a method, as it travels to the worker that carries it out, and back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from harness.pipeline.inputs.sources import Source
from harness.pipeline.run.chosen_method import MethodRef


@dataclass(frozen=True, slots=True)
class Trial:
    """What one trial is.

    Attributes:
        source: The dataset, with the subject alone.
        method: The method with its settings.
        capture: Folder of the photos that it is given.
        seed: What it is given as a seed.
        folder: Receives the mesh.
    """

    source: Source
    method: MethodRef
    capture: Path
    seed: int
    folder: Path


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
