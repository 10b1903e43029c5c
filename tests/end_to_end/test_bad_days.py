"""Signals at any moment, outputs that take nothing or know few letters, a folder that is gone."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import pytest

PROGRAM = [sys.executable, "-P", str(Path(__file__).parents[2] / "mexecon_harness.py")]
EVAL = ("eval", "--dataset", "toy", "--recipe", "tiny", "--method", "gt", "--jobs", "2")

PROGRESS = re.compile(r"(photos|reconstructions): \d+ of \d+")

#: What the program imports first, in place of Typer: it says so, and waits for a signal.
WAITING = "import time\nprint('importing', flush=True)\ntime.sleep(60)\n"


def assert_stopped(number: signal.Signals, code: int | None, errors: str) -> None:
    """One line, after those of the progress, and the exit code that a shell expects."""
    own = [line for line in errors.splitlines() if not PROGRESS.match(line)]
    assert (code, own) == (
        128 + number,
        [f"harness: stopped by {number.name}; what is finished is kept, and the same command "
         "continues"],
    )  # fmt: skip


def begun(*command: str, cwd: Path | None = None, **more: str) -> subprocess.Popen[str]:
    """A command that has begun."""
    return subprocess.Popen(
        command,
        cwd=cwd,
        env={**os.environ, **more},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


SIGNALS = [signal.SIGINT, signal.SIGTERM]
if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # as under nohup
    SIGNALS.append(signal.SIGHUP)


@pytest.fixture
def importing(tmp_path: Path) -> Mapping[str, str]:
    """Variables with which the program waits while it imports."""
    (tmp_path / "typer.py").write_text(WAITING)
    return {"PYTHONPATH": str(tmp_path)}


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_during_the_imports_is_answered_with_one_line(importing, number):
    run = begun(*PROGRAM, "--help", **importing)
    assert run.stdout is not None
    assert run.stdout.readline() == "importing\n"
    run.send_signal(number)
    _, errors = run.communicate(timeout=60)

    assert_stopped(number, run.returncode, errors)


def test_nohup_keeps_a_hangup_away(importing):
    run = begun("nohup", *PROGRAM, "--help", **importing)
    assert run.stdout is not None
    assert run.stdout.readline() == "importing\n"
    run.send_signal(signal.SIGHUP)
    time.sleep(0.2)
    assert run.poll() is None
    run.send_signal(signal.SIGTERM)
    _, errors = run.communicate(timeout=60)

    assert_stopped(signal.SIGTERM, run.returncode, errors)


def test_a_signal_during_the_work_leaves_no_temporary_file(world, tmp_path):
    number = signal.SIGTERM
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    run = begun(*PROGRAM, *EVAL, cwd=world, TMPDIR=str(temporary))
    end = time.monotonic() + 60
    while not any(temporary.iterdir()) and time.monotonic() < end:
        time.sleep(0.01)
    run.send_signal(number)
    _, errors = run.communicate(timeout=60)

    assert_stopped(number, run.returncode, errors)
    assert list(temporary.iterdir()) == []
    assert list(world.rglob("*.part*")) == []


def ended(*arguments: str, redirection: str = "", folder: Path | None = None, **more: str):
    """A command, its output redirected by a shell."""
    words = ["sh", "-c", f'"$@" {redirection}', "sh", *PROGRAM, *arguments]
    return subprocess.run(
        words, cwd=folder, env={**os.environ, **more}, capture_output=True, check=False
    )


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_output_is_told_in_one_line(unbuffered):
    done = ended("--help", redirection="> /dev/full", PYTHONUNBUFFERED=unbuffered)

    assert done.returncode == 3
    assert done.stderr.decode() == (
        "harness: could not write to standard output: No space left on device. What the command "
        "put into files is there\n"
    )


def test_a_closed_output_is_told_in_one_line():
    done = ended("--version", redirection=">&-")

    assert done.returncode == 3
    assert done.stderr == (
        b"harness: standard output is closed. To have no output, add: > /dev/null\n"
    )


def test_what_is_printed_moves_no_cursor(tmp_path):
    name = "\x1b[2J\u202e.md"
    done = ended("report", "--table", "published", "-o", name, folder=tmp_path, PYTHONUTF8="1")

    assert done.stdout.decode() == "\ufffd[2J\ufffd.md\n"
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", [".", "", "..", "/", "a" * 300])
def test_what_is_no_place_for_a_file_is_told_in_one_line(tmp_path, name):
    done = ended("report", "--table", "published", "-o", name, folder=tmp_path)

    assert done.returncode == 2 + (len(name) < 3)
    assert re.fullmatch(
        rb"harness: (could not write /.*|no file can be at .*: File name too long)\n", done.stderr
    )
    assert list(tmp_path.iterdir()) == []


def test_closed_errors_disturb_nothing():
    assert ended("--version", redirection="2>&-").stdout.startswith(b"harness ")
    assert ended("nosuchverb", redirection="2>&-").returncode == 2


def test_a_folder_that_is_gone_is_told_in_one_line(tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    words = ["sh", "-c", 'rmdir "$PWD"; "$@"', "sh", *PROGRAM, "data", "list"]
    done = subprocess.run(words, cwd=gone, capture_output=True, text=True, check=False)

    assert done.returncode == 2
    assert done.stderr == (
        "harness: the current folder is not there any more. Change to one that is: cd\n"
    )


def test_letters_that_an_output_lacks_are_written_as_escapes(measured, harness, world):
    encoding = "latin-1"
    whole = harness("report", "--table", "geometry").stdout
    done = ended("report", "--table", "geometry", folder=world, PYTHONIOENCODING=encoding)

    assert done.stderr == b""
    assert "↓" in whole
    assert done.stdout == whole.encode(encoding, "backslashreplace")


def test_a_locale_without_letters_is_no_obstacle(measured, world):
    locale = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0", "PYTHONIOENCODING": ""}
    done = ended("report", "--table", "geometry", folder=world, **locale)

    assert (done.returncode, done.stderr) == (0, b"")
    assert rb"Chamfer (mm) \u2193" in done.stdout


def answers_signals(process: int) -> bool:
    """Whether a process has a handler for SIGTERM, which Python by itself has not."""
    status = Path("/proc", str(process), "status").read_text()
    caught = int(re.search(r"^SigCgt:\s*(\w+)$", status, re.MULTILINE)[1], 16)
    return bool(caught & 1 << signal.SIGTERM - 1)


SWEPT = [(["--help"], number) for number in SIGNALS]
SWEPT += [(["report", "--table", "geometry"], number) for number in SIGNALS]


@pytest.mark.nightly
@pytest.mark.parametrize(("arguments", "number"), [*SWEPT, ([*EVAL], signal.SIGINT)])
def test_a_signal_at_every_moment(measured, world, tmp_path, arguments, number):
    """Each 50 ms, from the program's first line to its end."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    codes: Counter[int] = Counter()
    wait_s = 0.0
    while not codes[0]:
        if "eval" in arguments:
            for name in ("captures", "runs"):
                shutil.rmtree(world / name, ignore_errors=True)
        run = begun(*PROGRAM, *arguments, cwd=world, TMPDIR=str(temporary))
        while not answers_signals(run.pid):
            time.sleep(0.001)
        time.sleep(wait_s)
        run.send_signal(number)
        _, errors = run.communicate(timeout=120)
        codes[run.returncode] += 1
        if run.returncode:
            assert_stopped(number, run.returncode, errors)
        assert list(temporary.iterdir()) == [], f"{wait_s:.2f} s"
        wait_s += 0.05
    print(f"{arguments[0]}, {number.name}: stopped {codes[128 + number]} times")

    assert codes[128 + number]
