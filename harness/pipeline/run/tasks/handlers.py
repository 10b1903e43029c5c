"""What a task does on the machine that it came to; the request is resolved there once a run."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from typing import Any

from harness.pipeline.progress import Progress
from harness.pipeline.run.evaluate import CellRun
from harness.pipeline.run.tasks.run_values import found_error, found_request

__all__ = ["cell", "photos"]

_lock = threading.Lock()
#: The run that this process works on, by its values; another one takes its place.
_current: dict[str, CellRun] = {}


def photos(
    values: Mapping[str, Any], before: Mapping[str, Any] | None, progress: Progress
) -> dict[str, object]:
    """The photos of a subject, made if need be: ``warnings``, or the ``error`` instead."""
    del before
    return _run(values).photos(values["subject"], progress)


def cell(
    values: Mapping[str, Any], before: Mapping[str, Any] | None, progress: Progress
) -> dict[str, object]:
    """A method on a subject; the record is filed, and the answer is ``CellRun.carried_out``'s."""
    run = _run(values)
    if before and "error" in before:
        run.known.put(values["subject"], found_error(before["error"]))
    return run.carried_out(values["row"], values["subject"], progress)


def _run(values: Mapping[str, Any]) -> CellRun:
    key = json.dumps([values["run"], values["request"]], sort_keys=True)
    with _lock:
        if key not in _current:
            made = CellRun(found_request(values["request"]))
            _current.clear()
            _current[key] = made
        return _current[key]
