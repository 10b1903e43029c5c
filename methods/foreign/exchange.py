"""Arrays to a worker in its own interpreter and back: two ``.npz`` files, and nothing unpickled.

The request holds arrays by name and ``settings``, a JSON object as text. The answer holds arrays by
name and ``report``, likewise; or only ``refusal``, a sentence for the user.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.array_files.npz import read_array_npz, write_npz
from harness.core.errors import Killed, MethodError
from harness.core.process.interrupts import require_not_stopped
from harness.core.process.workers import ending
from methods.foreign import start
from methods.foreign.interpreter import Interpreter, environment_of
from methods.foreign.manifest import Worker
from methods.foreign.running import shown, wait_for

_TEXTS = ("report", "refusal")


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a worker said.

    Attributes:
        arrays: By name.
        report: JSON values that a reader of the record should know.
    """

    arrays: Mapping[str, NDArray[Any]]
    report: Mapping[str, Any]


def asked(
    worker: Worker,
    interpreter: Interpreter,
    arrays: Mapping[str, NDArray[Any]],
    settings: Mapping[str, object],
) -> Answer:
    """The answer of a worker; it runs in a process of its own, which ends with this one.

    Raises:
        MethodError: it refused, died, or answered with something else than arrays.
        Killed: it was killed, as when memory runs out.
        Interrupted: the run was stopped, and the worker with it.
    """
    require_not_stopped()
    with tempfile.TemporaryDirectory(prefix="harness-worker-") as name:
        folder = Path(name)
        request, answer, log = folder / "request.npz", folder / "answer.npz", folder / "log.txt"
        sent = {**arrays, "settings": np.array(json.dumps(settings))}
        write_npz(request, sent, compressed=False)
        words = worker.words(
            {
                "python": interpreter.program,
                "start": str(Path(start.__file__).resolve()),
                "parent": str(os.getpid()),
                "script": str(worker.script_path.resolve()),
                "request": str(request),
                "answer": str(answer),
            }
        )
        status = _run(worker, words, environment_of(interpreter, os.environ), log)
        if not answer.is_file():
            kind = Killed if status == -signal.SIGKILL else MethodError
            raise kind(
                f"the worker '{worker.name}' ended with {ending(status)} and no answer",
                got=interpreter.program,
                hint=f"Last lines of its log:\n{_tail(log)}",
            )
        return _read(worker, answer)


def _run(worker: Worker, words: list[str], environment: dict[str, str], log: Path) -> int:
    with log.open("wb") as stream:
        try:
            process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=environment,
                cwd=log.parent,
                # Ctrl-C is for the run, which ends its workers itself.
                process_group=0,
            )
        except OSError as error:
            raise MethodError(
                f"the worker '{worker.name}' could not be started",
                got=f"{words[0]}: {error.strerror or error}",
                hint="Check the interpreter that it was imported with",
            ) from error
        try:
            wait_for(process)
        finally:
            process.kill()
            process.wait()
    return process.returncode


def _read(worker: Worker, path: Path) -> Answer:
    found = read_array_npz(path)
    if "refusal" in found:
        raise MethodError(f"the worker '{worker.name}' refused: {found['refusal'].item()}")
    report = json.loads(str(found["report"].item())) if "report" in found else {}
    return Answer({name: found[name] for name in found if name not in _TEXTS}, report)


def _tail(log: Path) -> str:
    return shown(log.read_text(encoding="utf-8", errors="replace").splitlines())
