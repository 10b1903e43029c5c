"""Runs in a child process: one subject's training samples for normal estimators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from harness.core.process.steps import StepReport
from harness.core.process.workers import worker_main
from harness.pipeline.inputs.sources import Source
from normal_training.sampling.samples import SampleSettings, make_samples

__all__ = ["SampleJob", "handle"]


@dataclass(frozen=True, slots=True)
class SampleJob:
    """Which samples to make of one subject.

    Attributes:
        source: The dataset, with this subject alone.
        settings: Number, size and seed of the samples.
        path: The file to write.
    """

    source: Source
    settings: SampleSettings
    path: Path

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            "source": self.source.to_dict(),
            "settings": asdict(self.settings),
            "path": str(self.path),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> SampleJob:
        """The job behind ``to_dict``."""
        return cls(
            Source.from_dict(values["source"]),
            SampleSettings(**values["settings"]),
            Path(values["path"]),
        )


def handle(job: dict[str, Any], report: StepReport) -> dict[str, object]:
    """Make the subject, if it is generated and not there, and write its samples."""
    asked = SampleJob.from_dict(job)
    (subject,) = asked.source.subjects
    if asked.source.is_generated:
        asked.source.make_avatar(subject)
    scan, mesh = asked.source.load(subject)
    make_samples(scan, mesh, asked.settings, asked.path, report)
    return {}


if __name__ == "__main__":
    worker_main(handle)
