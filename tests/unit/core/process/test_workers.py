"""Worker processes: what comes back, what a crash leaves, and who dies with whom."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from harness.core import errors
from harness.core.errors import HarnessError, MethodError
from harness.core.process import forks
from harness.core.process.interrupts import Interrupted, in_threads, stopped_by_signals
from harness.core.process.workers import WorkerDied, run_worker

#: A worker that does what its job says.
SAMPLE = """
import os, signal, sys, time
from harness.core.errors import DataError
from harness.core.process.workers import worker_main


class OwnError(DataError):
    '''Known to this worker alone.'''


def handle(job, progress):
    kind = job["kind"]
    if kind == "echo":
        return {"job": job, "pid": os.getpid(), "path": sys.path, "group": os.getpgrp()}
    if kind == "variable":
        return {"SAMPLE": os.environ["SAMPLE"], "inherits": "PATH" in os.environ}
    if kind == "progress":
        for done in range(1, 4):
            progress(done, 3)
        sys.stdout.write("@progress of a kind\\n@progress 1")
        sys.stdout.flush()
        time.sleep(0.2)
        sys.stdout.write("2/12\\n")
        return {}
    if kind == "error":
        raise DataError("bad mesh", expected="a", got="b", hint="Mend it")
    if kind == "own error":
        raise OwnError("own")
    if kind == "crash":
        print(*(f"line {i}" for i in range(100)), sep="\\n")
        progress(1, 2)
        raise RuntimeError("unheard of")
    if kind == "signal":
        print("before", flush=True)
        os.kill(os.getpid(), signal.SIGSEGV)
    if kind == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "crash on the way out":
        import atexit
        atexit.register(os.abort)
        return {"done": True}
    if kind == "sleep":
        print("pid", os.getpid(), flush=True)
        time.sleep(60)
    if kind == "busy":
        print("pid", os.getpid(), flush=True)
        sum(range(10**12))  # one native call that never lets another thread run
    if kind == "nan":
        return {"value": float("nan")}


worker_main(handle)
"""


@pytest.fixture(scope="module")
def fork_server() -> Iterator[forks.ForkServer]:
    """Has imported next to nothing."""
    server = forks.ForkServer(["json"])
    yield server
    server.close()


@pytest.fixture(autouse=True, params=["fresh", "forked"])
def sample(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    fork_server: forks.ForkServer,
    request: pytest.FixtureRequest,
) -> str:
    """Puts ``sample_worker`` on the workers' path; they start afresh, or in forks."""
    if request.param == "forked":
        assert wait_until(fork_server.is_ready)
        monkeypatch.setattr(forks, "_serving", [fork_server])
    folder = tmp_path / "modules"
    folder.mkdir()
    (folder / "sample_worker.py").write_text(SAMPLE)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return request.param


def run(kind: str, **options: object) -> dict:
    worker = forks.ForkedWorker("sample_worker")
    return run_worker(worker, {"kind": kind, "n": 3}, **options)  # type: ignore[arg-type]


def wait_until(condition: Callable[[], bool], seconds: float = 10.0) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    return condition()


def alive(pid: int) -> bool:
    status = Path(f"/proc/{pid}/status")
    return status.is_file() and "State:\tZ" not in status.read_text()


def test_a_result_comes_back_from_another_process() -> None:
    result = run("echo")

    assert result["job"] == {"kind": "echo", "n": 3}
    assert result["pid"] != os.getpid()


def test_a_worker_starts_with_the_variables_given() -> None:
    assert run("variable", environment={"SAMPLE": "here"}) == {"SAMPLE": "here", "inherits": True}


def test_the_working_folder_is_not_on_the_workers_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "json.py").write_text("raise RuntimeError('not the real one')")
    monkeypatch.chdir(tmp_path)

    assert str(tmp_path) not in run("echo")["path"]


def test_progress_is_passed_on_and_look_alikes_are_not() -> None:
    seen: list[tuple[int, int]] = []

    run("progress", progress=lambda done, total: seen.append((done, total)))

    assert seen == [(1, 3), (2, 3), (3, 3), (12, 12)]


def test_an_error_of_ours_travels_as_what_it_is() -> None:
    with pytest.raises(errors.DataError) as caught:
        run("error")

    assert type(caught.value) is errors.DataError
    assert str(caught.value) == "bad mesh (expected a; got b). Mend it"


def test_an_error_only_the_worker_knows_travels_as_its_nearest_kin() -> None:
    with pytest.raises(HarnessError, match="own") as caught:
        run("own error")

    assert type(caught.value) is errors.DataError


def test_a_crash_gives_the_exit_status_and_the_logs_tail(tmp_path: Path) -> None:
    log = tmp_path / "logs" / "log.txt"

    with pytest.raises(MethodError, match="exit status 1 and no result") as caught:
        run("crash", log=log)

    message = str(caught.value)
    assert "RuntimeError: unheard of" in message
    assert "line 3\n" not in message, "only the tail"
    assert "@progress" not in message
    assert "line 3\n" in log.read_text()


def test_a_death_by_signal_names_the_signal() -> None:
    with pytest.raises(MethodError, match="signal SIGSEGV and no result(.|\n)*before"):
        run("signal")


def test_a_kill_says_that_memory_may_have_run_out() -> None:
    with pytest.raises(WorkerDied, match="SIGKILL .*when memory runs out.* and no result") as died:
        run("killed")
    assert died.value.by_signal is signal.SIGKILL


def test_a_hang_ends_after_the_time_limit(tmp_path: Path) -> None:
    log = tmp_path / "log.txt"
    begin = time.monotonic()
    with pytest.raises(WorkerDied, match="no result after 2 seconds and was stopped") as died:
        run("sleep", log=log, timeout_s=2.0)

    assert time.monotonic() - begin < 20
    assert "--timeout" in str(died.value)
    assert died.value.by_signal is None
    assert not alive(int(log.read_text().split()[1]))


def test_a_worker_has_this_processs_variables_of_now(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SAMPLE", "now")
    assert run("variable") == {"SAMPLE": "now", "inherits": True}


def test_many_workers_at_once_do_not_mix() -> None:
    pids = in_threads(lambda _: run("echo")["pid"], range(12), jobs=4)
    assert len(set(pids)) == 12


def test_a_server_that_is_gone_starts_nothing_more(
    fork_server: forks.ForkServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = forks.ForkServer(())
    assert wait_until(other.is_ready)
    other.close()
    monkeypatch.setattr(forks, "_serving", [other])
    assert forks.server() is None
    assert run("echo")["job"]["kind"] == "echo"


def test_a_worker_in_time_is_not_stopped() -> None:
    assert run("echo", timeout_s=60.0)["job"]["kind"] == "echo"


def test_a_signal_to_the_run_ends_its_workers_and_begins_no_other(tmp_path: Path) -> None:
    log = tmp_path / "log.txt"

    def interrupt() -> None:
        wait_until(lambda: log.is_file() and log.read_text().endswith("\n"))
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    with stopped_by_signals():
        with pytest.raises(Interrupted):
            in_threads(lambda kind: run(kind, log=log), ["sleep"], jobs=1)
        with pytest.raises(Interrupted):
            run("echo")
    assert not alive(int(log.read_text().split()[1]))


def test_ctrl_c_in_the_terminal_does_not_reach_a_worker() -> None:
    assert run("echo")["group"] != os.getpgrp()


def test_a_result_counts_even_if_the_worker_dies_on_its_way_out() -> None:
    assert run("crash on the way out") == {"done": True}


def test_a_result_that_is_not_json_is_a_crash() -> None:
    with pytest.raises(MethodError, match="Out of range float values"):
        run("nan")


def test_a_module_that_does_not_exist() -> None:
    with pytest.raises(MethodError, match="No module named 'absent_worker'|absent_worker"):
        run_worker(forks.ForkedWorker("absent_worker"), {})


def test_an_interrupted_parent_kills_its_worker(tmp_path: Path) -> None:
    log = tmp_path / "log.txt"

    class InterruptError(Exception):
        pass

    def interrupt(done: int, total: int) -> None:
        raise InterruptError

    with pytest.raises(InterruptError):
        run("progress", log=log, progress=interrupt)
    assert "12/12" not in log.read_text()


@pytest.mark.parametrize("kind", ["sleep", "busy"])
def test_a_worker_dies_with_a_parent_that_was_killed(
    tmp_path: Path, kind: str, sample: str
) -> None:
    log = tmp_path / "log.txt"
    script = (
        "import sys; from pathlib import Path\n"
        "from harness.core.process import forks\n"
        "from harness.core.process.workers import run_worker\n"
        "forks.LIBRARIES = ()\n"
        "wanted = sys.argv[3] == 'forked'\n"
        "with forks.serving(wanted=wanted):\n"
        "    while wanted and not forks.server(): pass\n"
        "    worker = forks.ForkedWorker('sample_worker')\n"
        "    run_worker(worker, {'kind': sys.argv[2]}, log=Path(sys.argv[1]))\n"
    )
    with subprocess.Popen([sys.executable, "-c", script, str(log), kind, sample]) as parent:
        assert wait_until(lambda: log.is_file() and log.read_text().endswith("\n"))
        worker = int(log.read_text().split()[1])
        assert alive(worker)

        os.kill(parent.pid, signal.SIGKILL)

    gone = wait_until(lambda: not alive(worker))
    if not gone:
        os.kill(worker, signal.SIGKILL)
    assert gone
