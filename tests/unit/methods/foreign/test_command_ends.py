"""Commands that cannot start, that fail, and what they leave behind."""

from __future__ import annotations

import shutil
import subprocess
import sys
import textwrap

import pytest

from harness.core.errors import Killed, MethodError, MissingPart
from tests.unit.methods.foreign.toys import described, runs, until


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (['image = "x"'], "no engine is installed"),
        (['conda = "x"'], "conda is not installed"),
        (['python = "gone/python"'], "interpreter of method 'toy' is not there"),
    ],
)
def test_what_is_missing_is_said(lines, said, folder, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CONDA_EXE", raising=False)
    with pytest.raises(MissingPart, match=said):
        _ = described(folder, *lines).info


def test_an_interpreter_that_does_not_run_is_said(folder):
    (folder / "python").write_text("#!/bin/sh\necho no such library >&2\nexit 3\n")
    (folder / "python").chmod(0o755)
    with pytest.raises(MissingPart, match="does not run.*no such library"):
        _ = described(folder, 'python = "python"').info


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("print('of the network'); raise SystemExit(3)", "exit status 3(.|\n)*of the network"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "exit status 139"),
        ("pass", "wrote no mesh"),
        ("import sys, os; os.symlink('/etc/passwd', sys.argv[2])", "wrote no mesh"),
        ("import sys; open(sys.argv[2], 'w').write('ply or so')", "cannot be used"),
    ],
)
def test_failures_are_the_methods_own(program, said, folder, capture, context):
    (folder / "run.py").write_text(program)
    with pytest.raises(MethodError, match=said):
        described(folder).reconstruct(capture, context)


def test_a_command_that_was_killed_did_not_fail_itself(folder, capture, context):
    (folder / "run.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    with pytest.raises(Killed, match="exit status 137"):
        described(folder).reconstruct(capture, context)


def test_views_that_are_not_there_are_refused(folder, capture, context):
    with pytest.raises(MethodError, match="takes view 9"):
        described(folder, "views = [9]").reconstruct(capture, context)
    shutil.rmtree(context.workdir)
    with pytest.raises(MethodError, match="takes 9 photos"):
        described(folder, "view_count = 9").reconstruct(capture, context)


#: Two processes that would stay: a child, and one in a session of its own.
STAYS = """\
import os, pathlib, subprocess, sys, time
sleep = [sys.executable, "-c", "import time; time.sleep(60)"]
child = subprocess.Popen(sleep)
away = subprocess.Popen(sleep, start_new_session=True)
pathlib.Path({mark!r}).write_text(" ".join(map(str, (os.getpid(), child.pid, away.pid))))
{after}
"""


def test_nothing_stays_behind_a_command_that_ended(folder, capture, context, tmp_path):
    mark = tmp_path / "alive"
    (folder / "run.py").write_text(STAYS.format(mark=str(mark), after=""))
    with pytest.raises(MethodError, match="wrote no mesh"):
        described(folder).reconstruct(capture, context)
    assert not [pid for pid in map(int, mark.read_text().split()) if runs(pid)]


def test_nothing_stays_when_the_process_that_asked_is_killed(folder, capture, tmp_path):
    mark = tmp_path / "alive"
    (folder / "run.py").write_text(STAYS.format(mark=str(mark), after="time.sleep(60)"))
    described(folder)
    program = textwrap.dedent(
        f"""
        import os
        from pathlib import Path
        from methods.foreign.running import run_guarded
        run_guarded([{sys.executable!r}, {str(folder / "run.py")!r}], os.environ, Path("/"))
        """
    )
    process = subprocess.Popen([sys.executable, "-c", program])
    try:
        until(lambda: mark.exists() and len(mark.read_text().split()) == 3)
        process.kill()
        process.wait()
        pids = [int(text) for text in mark.read_text().split()]
        until(lambda: not any(map(runs, pids)))
    finally:
        process.kill()
        process.wait()
