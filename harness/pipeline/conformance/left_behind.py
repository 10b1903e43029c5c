"""Processes that a trial started and that are still there."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from pathlib import Path

#: An environment variable that a trial's worker starts with, by which its processes are found:
#: what it forks has it too, also before it runs another program.
MARK = "CONFORM_TRIAL"

#: How long a process may take to end after the one that started it.
_PATIENCE_S = 5.0
_POLL_S = 0.1
_PROC = Path("/proc")


def left_behind(mark: str) -> tuple[int, ...] | None:
    """The process ids with a mark, once they had time to end; None where nobody can say."""
    if not (_PROC / "self" / "environ").is_file():
        return None
    end = time.monotonic() + _PATIENCE_S
    while (found := _marked(mark)) and time.monotonic() < end:
        time.sleep(_POLL_S)
    return found


def ended(processes: tuple[int, ...]) -> None:
    """End processes of a trial that did not end with it."""
    for process in processes:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(process, signal.SIGKILL)


def _marked(mark: str) -> tuple[int, ...]:
    wanted = f"{MARK}={mark}".encode()
    found: list[int] = []
    for entry in _PROC.glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if wanted in (entry / "environ").read_bytes().split(b"\0") and not _is_dead(entry):
                found.append(int(entry.name))
    return tuple(sorted(found))


def _is_dead(entry: Path) -> bool:
    return (entry / "stat").read_text().rpartition(")")[2].split()[0] == "Z"
