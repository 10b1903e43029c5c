"""What a task does on the machine that it came to; the request is resolved there once a run."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from harness.pipeline.progress import Progress
from harness.pipeline.run.evaluate import CellRun
from harness.pipeline.run.tasks.run_values import found_error, found_methods, found_request

_lock = threading.Lock()
#: The run that this process works on, by its id; another one takes its place.
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
    """The run, with the methods that a task names.

    Of a run with many methods, a worker resolves those alone that it is asked for.
    """
    request, name = values["request"], values["run"]
    with _lock:
        if name not in _current:
            made = CellRun(found_request({**request, "methods": []}))
            _current.clear()
            _current[name] = made
        run = _current[name]
    methods = found_methods(request, run.request.source.workspace)
    return replace(run, request=replace(run.request, methods=methods))
