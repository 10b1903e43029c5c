"""Runs in a child process: one subject's avatar, if generated, and its photos."""

from __future__ import annotations

from dataclasses import dataclass

from harness.core.process.threads import StepReport
from harness.core.process.workers import worker_main
from harness.run.sources import Source


@dataclass(frozen=True, slots=True)
class CaptureJob:
    """What to make of one subject.

    Attributes:
        source: The dataset and the recipe, with this subject alone.
        only_scan: Whether the avatar is enough, without photos.
    """

    source: Source
    only_scan: bool = False


def handle(job: CaptureJob, report: StepReport) -> dict[str, object]:
    """Make what is missing; everything that the caller wants to know is on disk then."""
    for subject in job.source.subjects:
        if job.only_scan:
            job.source.make_avatar(subject)
        else:
            job.source.ensure_capture(subject, report)
    return {}


if __name__ == "__main__":
    worker_main(handle)
