"""A foreign process that is followed to its end, and stopped with the run."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import Killed, MethodError
from harness.core.files.npz import read_array_npz, write_npz
from harness.core.process.interrupts import require_not_stopped
from harness.core.process.workers import ending
from methods.foreign import guard, start
from methods.foreign.interpreter import Interpreter, environment_of
from methods.foreign.method_file import Worker

_POLL_S = 0.1
_TAIL_LINES = 15
#: What the guard needs to end what the command left behind.
_GUARD_S = 10.0
#: Exit statuses above this are those of signals.
_OF_SIGNALS = 128


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command ended.

    Attributes:
        status: Its exit status; 128 and a signal's number after a signal.
        tail: The last lines of what it printed.
    """

    status: int
    tail: tuple[str, ...]

    @property
    def was_killed(self) -> bool:
        """Whether it was killed, as the system does when memory runs out."""
        return self.status == _OF_SIGNALS + signal.SIGKILL

    @property
    def log(self) -> str:
        """The tail for a message."""
        return f"Last lines of its log:\n{shown(self.tail)}"


def shown(lines: Sequence[str]) -> str:
    """The last lines of a log, as messages show them."""
    kept = [line for line in lines if line.strip()][-_TAIL_LINES:]
    return "\n".join(f"  | {line}" for line in kept) or "  | (empty)"


def run_guarded(words: Sequence[str], environment: Mapping[str, str], folder: Path) -> Ended:
    """Run a command; what it prints goes to standard output, and nothing that it started stays.

    Args:
        words: The command.
        environment: All its environment variables.
        folder: Where it runs.

    Raises:
        MethodError: it could not be started.
        Interrupted: the run was stopped, and the command with it.
    """
    require_not_stopped()
    guarded = [sys.executable, "-I", str(Path(guard.__file__).resolve()), str(os.getpid()), *words]
    tail: deque[str] = deque(maxlen=4 * _TAIL_LINES)
    try:
        process = subprocess.Popen(
            guarded,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=dict(environment),
            cwd=folder,
            # Ctrl-C is for the run, which ends its workers itself.
            process_group=0,
        )
    except OSError as error:
        raise MethodError(f"{folder} could not be entered", got=error.strerror or "") from error
    assert process.stdout is not None
    reader = threading.Thread(target=_passed_on, args=(process.stdout, tail), daemon=True)
    reader.start()
    try:
        wait_for(process)
    finally:
        _stopped(process)
        reader.join(_GUARD_S)
    return Ended(process.returncode, tuple(tail))


def wait_for(process: subprocess.Popen[bytes]) -> None:
    """Return when a process has ended.

    Raises:
        Interrupted: the run was stopped; the process goes on.
    """
    while process.poll() is None:
        require_not_stopped()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_POLL_S)


def _stopped(process: subprocess.Popen[bytes]) -> None:
    """End a guard, which ends all others first."""
    process.terminate()
    try:
        process.wait(_GUARD_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _passed_on(stream: IO[bytes], tail: deque[str]) -> None:
    with stream:
        for line in stream:
            text = line.decode("utf-8", errors="replace").rstrip("\n")
            tail.append(text)
            sys.stdout.write(f"{text}\n")
            sys.stdout.flush()


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
