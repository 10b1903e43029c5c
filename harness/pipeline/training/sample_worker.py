"""Runs in a child process: one subject's training samples for normal estimators."""

from __future__ import annotations

from pathlib import Path

from harness.core.process.workers import Progress, worker_main
from harness.pipeline.inputs.sources import Source
from harness.pipeline.training.samples import SampleSettings, make_samples

__all__ = ["handle"]


def handle(job: dict[str, object], progress: Progress) -> dict[str, object]:
    """Make the subject, if it is generated and not there, and its samples."""
    source = Source.from_job(job["source"], str(job["subject"]))  # type: ignore[arg-type]
    subject = source.subjects[0]
    if source.is_generated:
        source.make_avatar(subject)
    scan, mesh = source.load(subject)
    settings = SampleSettings(**job["settings"])  # type: ignore[arg-type]
    make_samples(scan, mesh, settings, Path(str(job["path"])), progress)
    return {}


if __name__ == "__main__":
    worker_main(handle)
