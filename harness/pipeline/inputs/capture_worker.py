"""Runs in a child process: one subject's avatar, if generated, and its photos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from harness.core.process.steps import StepReport
from harness.core.process.workers import worker_main
from harness.pipeline.inputs.sources import Source


@dataclass(frozen=True, slots=True)
class CaptureJob:
    """What to make of one subject.

    Attributes:
        source: The dataset and the recipe, with this subject alone.
        only_scan: Whether the avatar is enough, without photos.
    """

    source: Source
    only_scan: bool = False

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {"source": self.source.to_dict(), "only_scan": self.only_scan}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> CaptureJob:
        """The job behind ``to_dict``."""
        return cls(Source.from_dict(values["source"]), values["only_scan"])


def handle(job: dict[str, Any], report: StepReport) -> dict[str, object]:
    """Make what is missing; everything that the caller wants to know is on disk then."""
    asked = CaptureJob.from_dict(job)
    for subject in asked.source.subjects:
        if asked.only_scan:
            asked.source.make_avatar(subject)
        else:
            asked.source.ensure_capture(subject, report)
    return {}


if __name__ == "__main__":
    worker_main(handle)
