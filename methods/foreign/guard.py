"""Runs a command, and ends everything that it started when it ends, or when its own parent is gone.

Standard library only: ``python guard.py PARENT WORD...``. The exit status is the command's.
On Linux, processes that the command left behind become children of this one, and are ended, too.
"""

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import FrameType

_POLL_S = 0.05
#: What a process has to end by itself: containers are stopped by their client in that time.
_GRACE_S = 2.0
_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36


class _Stopped(Exception):
    """Someone asked this process to end."""


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(option, value)


def _stop(_number: int, _frame: FrameType | None) -> None:
    raise _Stopped


def _followed(command: subprocess.Popen[bytes], parent: int) -> int | None:
    """The command's exit status; None where the parent was gone before."""
    while command.poll() is None:
        if os.getppid() != parent:
            return None
        time.sleep(_POLL_S)
    return command.returncode


def _left(own: int) -> list[int]:
    """All living processes below this one."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, ValueError):
            state, parent = (entry / "stat").read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                children.setdefault(int(parent), []).append(int(entry.name))
    found: list[int] = []
    waiting = [own]
    while waiting:
        below = children.get(waiting.pop(), [])
        found += below
        waiting += below
    return found


def _end(number: signal.Signals, processes: list[int]) -> None:
    for process in processes:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(process, number)


def _cleaned(command: subprocess.Popen[bytes]) -> None:
    """End the command and all that it started; politely first."""
    end, number = time.monotonic() + _GRACE_S, signal.SIGTERM
    while True:
        command.poll()
        left = _left(os.getpid()) or ([command.pid] if command.poll() is None else [])
        if not left:
            return
        if time.monotonic() > end:
            number = signal.SIGKILL
        _end(number, left)
        time.sleep(_POLL_S)
        _reap()


def _reap() -> None:
    """Collect processes that were left to this one."""
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def main(parent: int, words: list[str]) -> int:
    """Run the words; the exit status is 128 and the signal's number after a signal."""
    signal.signal(signal.SIGTERM, _stop)
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)
    status: int | None = None
    try:
        command = subprocess.Popen(
            words,
            # Should this process be killed itself, then its command is, too. It has one thread.
            preexec_fn=lambda: _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL),  # noqa: PLW1509
        )
    except OSError as error:
        sys.stderr.write(f"{words[0]}: {error.strerror or error}\n")
        return 127
    try:
        with contextlib.suppress(_Stopped):
            status = _followed(command, parent)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        _cleaned(command)
    if status is None:
        return 1
    return 128 - status if status < 0 else status


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), sys.argv[2:]))
