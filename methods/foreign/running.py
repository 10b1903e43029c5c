"""A foreign process that is followed to its end, and stopped with the run."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from harness.core.errors import MethodError
from harness.core.process.interrupts import require_not_stopped
from methods.foreign import guard

#: A command's last line starts with this where it says in a sentence why it cannot go on.
REFUSED = "refused: "
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
    def refusal(self) -> str:
        """What it refused with, if its last line says that it did; else empty."""
        last = next((line for line in reversed(self.tail) if line.strip()), "")
        return last.removeprefix(REFUSED) if last.startswith(REFUSED) else ""

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
