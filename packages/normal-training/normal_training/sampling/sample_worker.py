"""Runs in a child process: one subject's training samples for normal estimators."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from harness.core.process.threads import StepReport
from harness.core.process.workers import worker_main
from harness.run.sources import Source
from normal_training.sampling.samples import SampleSettings, make_samples


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


def handle(job: SampleJob, report: StepReport) -> dict[str, object]:
    """Make the subject, if it is generated and not there, and write its samples."""
    (subject,) = job.source.subjects
    if job.source.is_generated:
        job.source.make_avatar(subject)
    scan, mesh = job.source.load(subject)
    make_samples(scan, mesh, job.settings, job.path, report)
    return {}


if __name__ == "__main__":
    worker_main(handle)
