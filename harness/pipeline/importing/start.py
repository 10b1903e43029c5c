"""Imports in a child process of their own, with progress."""

from __future__ import annotations

from pathlib import Path

from harness.core.process.workers import run_worker
from harness.data.captures.reading import read_cameras
from harness.pipeline.importing.request import Imported, ImportRequest
from harness.pipeline.progress import Progress, counted

_WORKER = "harness.pipeline.importing.import_worker"
_PHOTOS = "photos"


def import_capture(
    request: ImportRequest, progress: Progress, timeout_s: float | None = None
) -> Imported:
    """Make a capture of photos with cameras.

    Args:
        request: Photos, cameras, and what is known of their world.
        progress: Hears of every photo.
        timeout_s: How long it may take; None is no limit.

    Raises:
        HarnessError: files that cannot be read, photos that contradict their cameras, or a world
            of which too little is known.
        MissingPart: MediaPipe is needed, and not installed.
    """
    progress.expect(_PHOTOS, len(read_cameras(Path(request.cameras)).views))
    answer = run_worker(
        _WORKER, request.to_dict(), progress=counted(progress, _PHOTOS), timeout_s=timeout_s
    )
    return Imported.from_dict(answer)
