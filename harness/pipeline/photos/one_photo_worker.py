"""Runs in a child process: one photo without a camera becomes a capture."""

from __future__ import annotations

from typing import Any

from harness.core.process.steps import StepReport
from harness.core.process.workers import worker_main
from harness.pipeline.photos.one_photo import OnePhotoRequest, import_one_photo


def handle(job: dict[str, Any], report: StepReport) -> dict[str, object]:  # noqa: ARG001
    """Import; the answer of ``Imported.to_dict``."""
    return import_one_photo(OnePhotoRequest.from_dict(job)).to_dict()


if __name__ == "__main__":
    worker_main(handle)
