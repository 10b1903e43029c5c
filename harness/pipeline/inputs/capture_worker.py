"""Runs in a child process: one subject's avatar, if generated, and its photos."""

from __future__ import annotations

from harness.core.process.workers import Progress, worker_main
from harness.pipeline.inputs.sources import Source

__all__ = ["handle"]


def handle(job: dict[str, object], progress: Progress) -> dict[str, object]:
    """Make what is missing; the capture's key, folder and warnings."""
    source = Source.from_job(job["source"], str(job["subject"]))  # type: ignore[arg-type]
    subject = source.subjects[0]
    if job["only_scan"]:
        return {
            "made": source.make_avatar(subject),
            "directory": str(source.avatar_directory(subject)),
        }
    capture = source.ensure_capture(subject, progress)
    return {
        "key": capture.key,
        "directory": str(capture.directory),
        "warnings": list(capture.warnings),
        "proof": capture.provenance.get("proof"),
    }


if __name__ == "__main__":
    worker_main(handle)
