"""Runs in a child process: photos of another program become a capture."""

from __future__ import annotations

from typing import Any

from harness.core.process.steps import StepReport
from harness.core.process.workers import worker_main
from harness.pipeline.importing.importing import import_photos
from harness.pipeline.importing.request import ImportRequest


def handle(job: dict[str, Any], report: StepReport) -> dict[str, object]:
    """Import; the answer of ``Imported.to_dict``."""
    return import_photos(ImportRequest.from_dict(job), report).to_dict()


if __name__ == "__main__":
    worker_main(handle)
