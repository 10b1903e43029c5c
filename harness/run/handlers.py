"""What a task does on the machine that it came to; the request is resolved there once a run."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from harness.core.errors import found_error
from harness.run.evaluate import CellRun
from harness.run.plan import SubjectJob
from harness.run.progress import Progress

_lock = threading.Lock()
#: The run that this process works on, by its id; another one takes its place.
_current: dict[str, CellRun] = {}


def photos(job: SubjectJob, before: object, progress: Progress) -> dict[str, object]:
    """The photos of a subject, made if need be: ``warnings``, or the ``error`` instead."""
    del before
    return _run(job).photos(job.subject, progress)


def cell(
    job: SubjectJob, before: Mapping[str, Any] | None, progress: Progress
) -> dict[str, object]:
    """A method on a subject; the record is filed, and the answer is ``CellRun.carried_out``'s."""
    run = _run(job)
    if before and "error" in before:
        run.known.put(job.subject, found_error(before["error"]))
    return run.carried_out(job.row, job.subject, progress)


def _run(job: SubjectJob) -> CellRun:
    """The run, with the methods that a task names.

    Of a run with many methods, a worker resolves those alone that it is asked for.
    """
    with _lock:
        if job.run not in _current:
            made = CellRun(replace(job.request, methods=()).found())
            _current.clear()
            _current[job.run] = made
        run = _current[job.run]
    return replace(run, request=job.request.found())
