"""The lock file: one holder at a time, and no stale lock after a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.core.errors import WriteError
from harness.core.files.atomic import exclusive_lock

HOLDER = """
import sys, time
from pathlib import Path
from harness.core.files.atomic import exclusive_lock
with exclusive_lock(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""

COUNTER = """
import sys
from pathlib import Path
from harness.core.files.atomic import exclusive_lock
lock, counter = Path(sys.argv[1]), Path(sys.argv[2])
for _ in range(100):
    with exclusive_lock(lock):
        counter.write_text(str(int(counter.read_text()) + 1))
"""


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that holds ``tmp_path / "lock"``."""
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "lock")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def waiter(lock: Path) -> tuple[threading.Thread, threading.Event]:
    got = threading.Event()

    def wait() -> None:
        with exclusive_lock(lock):
            got.set()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread, got


def test_a_lock_waits_for_its_holder_and_survives_its_sigkill(
    tmp_path: Path, holder: subprocess.Popen[str]
) -> None:
    thread, got = waiter(tmp_path / "lock")
    assert not got.wait(0.2)

    os.kill(holder.pid, signal.SIGKILL)

    assert got.wait(10)
    thread.join(10)


def test_threads_of_one_process_exclude_each_other(tmp_path: Path) -> None:
    with exclusive_lock(tmp_path / "lock"):
        thread, got = waiter(tmp_path / "lock")
        assert not got.wait(0.1)
    assert got.wait(10)
    thread.join(10)


def test_an_error_lets_go_of_the_lock(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), exclusive_lock(tmp_path / "new" / "lock"):
        raise ZeroDivisionError

    thread, got = waiter(tmp_path / "new" / "lock")
    assert got.wait(10)
    thread.join(10)


def test_processes_that_count_together_lose_nothing(tmp_path: Path) -> None:
    counter = tmp_path / "counter"
    counter.write_text("0")
    command = [sys.executable, "-c", COUNTER, str(tmp_path / "lock"), str(counter)]

    processes = [subprocess.Popen(command) for _ in range(3)]

    assert [process.wait(30) for process in processes] == [0, 0, 0]
    assert counter.read_text() == "300"


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(WriteError, match=r"could not write .*file/\.lock: File exists"),
        exclusive_lock(tmp_path / "file" / ".lock"),
    ):
        pass
