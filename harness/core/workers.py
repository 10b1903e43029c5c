"""Child processes: a job file goes in, a result file and the log's tail come out.

Blender, torch and Open3D never share a process; each job runs in a fresh interpreter that dies with
its parent, so that a killed run leaves nothing behind.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from harness.core import errors as error_classes
from harness.core.errors import HarnessError, MethodError
from harness.core.files import read_json, write_json

__all__ = ["run_worker", "worker_main"]

_TAIL_LINES = 15
_POLL_S = 0.05
_PARENT_POLL_S = 0.5
_PROGRESS_PREFIX = "@progress "

Progress = Callable[[int, int], None]


def run_worker(
    module: str,
    job: Mapping[str, object],
    *,
    log: Path | None = None,
    progress: Progress | None = None,
) -> dict[str, object]:
    """The result of ``python -m module`` on a job.

    Args:
        module: Dotted name of a module that ends in ``worker_main(handle)``.
        job: JSON values handed to it.
        log: Where its output is kept; a temporary file by default.
        progress: Called with (done, total) whenever the worker says so.

    Raises:
        HarnessError: the one that the worker raised, by class, or ``MethodError`` with the exit
            status and the log's tail when it died.
    """
    with tempfile.TemporaryDirectory(prefix="harness-job-") as folder:
        job_path, result_path = Path(folder, "job.json"), Path(folder, "result.json")
        log_path = log or Path(folder, "log.txt")
        log_path.parent.mkdir(parents=True, exist_ok=True)
        write_json(job_path, {"parent": os.getpid(), "job": dict(job)})
        with log_path.open("wb") as stream:
            process = subprocess.Popen(
                [sys.executable, "-m", module, str(job_path), str(result_path)],
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
            )
            try:
                _follow(process, log_path, progress)
            finally:
                if process.poll() is None:
                    process.kill()
                    process.wait()
        if not result_path.is_file():
            raise MethodError(
                f"worker {module} ended with exit status {process.returncode} and no result",
                hint=f"Last lines of its log:\n{_tail(log_path)}",
            )
        result = read_json(result_path)
    failure = result.get("error")
    if isinstance(failure, dict):
        kind = getattr(error_classes, str(failure["kind"]), HarnessError)
        raise kind(
            str(failure["what"]),
            expected=str(failure["expected"]),
            got=str(failure["got"]),
            hint=str(failure["hint"]),
        )
    return result["value"]  # type: ignore[return-value]


def _follow(process: subprocess.Popen[bytes], log: Path, progress: Progress | None) -> None:
    with log.open("r", encoding="utf-8", errors="replace") as stream:
        while True:
            ended = process.poll() is not None
            for line in stream.read().splitlines():
                if progress and line.startswith(_PROGRESS_PREFIX):
                    done, total = line.removeprefix(_PROGRESS_PREFIX).split("/")
                    progress(int(done), int(total))
            if ended:
                return
            time.sleep(_POLL_S)


def _tail(log: Path) -> str:
    lines = [
        line
        for line in log.read_text(encoding="utf-8", errors="replace").splitlines()
        if line.strip() and not line.startswith(_PROGRESS_PREFIX)
    ]
    return "\n".join(f"  | {line}" for line in lines[-_TAIL_LINES:]) or "  | (empty)"


def worker_main(
    handle: Callable[[dict[str, object], Progress], dict[str, object]],
) -> None:
    """Run a worker: read the job file, call ``handle(job, progress)``, write the result.

    A ``HarnessError`` travels to the parent as what it is; anything else ends the process with its
    traceback in the log.
    """
    job_path, result_path = Path(sys.argv[1]), Path(sys.argv[2])
    document = read_json(job_path)
    _die_with(int(document["parent"]))  # type: ignore[call-overload]
    try:
        result: dict[str, object] = {"value": handle(document["job"], _say_progress)}  # type: ignore[arg-type]
    except HarnessError as error:
        result = {
            "error": {
                "kind": type(error).__name__,
                "what": error.what,
                "expected": error.expected,
                "got": error.got,
                "hint": error.hint,
            }
        }
    write_json(result_path, json.loads(json.dumps(result)))


def _say_progress(done: int, total: int) -> None:
    sys.stdout.write(f"{_PROGRESS_PREFIX}{done}/{total}\n")
    sys.stdout.flush()


def _die_with(parent: int) -> None:
    """End this process soon after its parent is gone, even if the parent was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_PARENT_POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
