"""Runs in a child process: one photo without a camera becomes a capture."""

from __future__ import annotations

from harness.core.process.steps import StepReport
from harness.core.process.workers import worker_main
from harness.pipeline.importing.request import Imported
from harness.pipeline.photos.one_photo import OnePhotoRequest, import_one_photo


def handle(job: OnePhotoRequest, report: StepReport) -> Imported:  # noqa: ARG001
    """Import."""
    return import_one_photo(job)


if __name__ == "__main__":
    worker_main(handle)
