"""Child processes: they read a job file, and write a result file and a log.

Blender, torch and Open3D never share a process. Each job runs in a fresh interpreter, or in a fork
of one, that ends with its parent, so that a killed run leaves no processes behind.
"""

import ctypes
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast, get_type_hints

from harness.core.errors import HarnessError, MethodError, error_values, found_error
from harness.core.files.atomic import read_json, write_json
from harness.core.missing import explained
from harness.core.process.blender import BlenderWorker
from harness.core.process.forks import Fork, ForkedWorker, ForkServer, server
from harness.core.process.interrupts import require_not_stopped
from harness.core.process.threads import StepReport
from harness.core.typed_json import from_json, to_json

_TAIL_LINES = 15
_POLL_S = 0.05
_PARENT_POLL_S = 0.5
_PROGRESS = re.compile(r"^@progress (\d+)/(\d+)\n", re.MULTILINE)
_PR_SET_PDEATHSIG = 1


class WorkerDied(MethodError):
    """A worker ended without a result.

    Attributes:
        by_signal: What ended it, or None after an exit or a time limit.
    """

    by_signal: signal.Signals | None = None


def run_worker(
    module: str | BlenderWorker | ForkedWorker,
    job: object,
    *,
    log: Path | None = None,
    progress: StepReport | None = None,
    timeout_s: float | None = None,
    environment: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """The result of ``python -m module`` on a job.

    A worker that wrote its result has succeeded, even if it crashes afterwards, as graphics drivers
    do. What it leaves in its folder for temporary files goes with it, however it ends.

    Args:
        module: Dotted name of a module that ends in ``worker_main(handle)``; what runs in Blender
            may run in another interpreter, and some start in forks within ``serving``.
        job: A dataclass of plain values, or JSON values, handed to it.
        log: Where its output is kept; a temporary file by default.
        progress: Called with (done, total) whenever the worker says so.
        timeout_s: The worker is ended after this time; None means no limit.
        environment: Variables that it has besides this process's.

    Raises:
        HarnessError: the error that the worker raised, with its class.
        WorkerDied: it ended without a result, or was ended after ``timeout_s``; with the log's
            tail.
        Interrupted: the run was stopped; so is the worker, and no other begins.
    """
    require_not_stopped()
    # What a killed worker started may write for a moment more.
    with tempfile.TemporaryDirectory(prefix="harness-job-", ignore_cleanup_errors=True) as folder:
        job_path, result_path = Path(folder, "job.json"), Path(folder, "result.json")
        log_path = log or Path(folder, "log.txt")
        log_path.parent.mkdir(parents=True, exist_ok=True)
        forks = server() if isinstance(module, ForkedWorker) else None
        name = module if isinstance(module, str) else module.module
        worker = module if isinstance(module, BlenderWorker) else BlenderWorker(name)
        # A program may be a script that starts another one, whose parent it is.
        parent = 0 if worker.command else forks.pid if forks else os.getpid()
        write_json(job_path, {"parent": parent, "job": to_json(job)})
        with log_path.open("wb") as stream:
            variables = {**os.environ, "TMPDIR": folder, **(environment or {})}
            process = _started(worker, forks, (job_path, result_path), stream, variables)
            try:
                in_time = _follow(process, log_path, progress, timeout_s)
            finally:
                process.kill()
                process.wait()
        if not result_path.is_file():
            status = process.returncode if in_time else None
            raise _death(worker.module, status, timeout_s, log_path)
        return _value(read_json(result_path))


def _started(
    worker: BlenderWorker,
    forks: ForkServer | None,
    files: tuple[Path, Path],
    log: BinaryIO,
    variables: Mapping[str, str],
) -> subprocess.Popen[bytes] | Fork:
    """The worker's process: a fork of the server's where there is one."""
    arguments = [str(file) for file in files]
    if forks:
        return forks.start(worker.module, arguments, output=log, errors=log, environment=variables)
    return subprocess.Popen(
        [*worker.start(files[0].parent), *arguments],
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=subprocess.STDOUT,
        env=variables,
        # Ctrl-C is for the run, which ends its workers itself.
        process_group=0,
    )


def _value(result: dict[str, Any]) -> dict[str, Any]:
    if failure := result.get("error"):
        raise found_error(failure)
    return result["value"]


def _follow(
    process: subprocess.Popen[bytes] | Fork,
    log: Path,
    progress: StepReport | None,
    timeout_s: float | None,
) -> bool:
    """Wait for a process to end and report its progress.

    Returns whether it ended by itself before the time limit.
    """
    end = math.inf if timeout_s is None else time.monotonic() + timeout_s
    pending = ""
    with log.open("r", encoding="utf-8", errors="replace") as stream:
        while True:
            require_not_stopped()
            late = time.monotonic() > end
            ended = process.poll() is not None
            lines, newline, pending = (pending + stream.read()).rpartition("\n")
            for done, total in _PROGRESS.findall(lines + newline):
                if progress:
                    progress(int(done), int(total))
            if ended or late:
                return ended
            time.sleep(_POLL_S)


def _death(module: str, status: int | None, timeout_s: float | None, log: Path) -> WorkerDied:
    """The error for a worker without a result; ``status`` is None after a time limit."""
    tail = f"Last lines of its log:\n{_tail(log)}"
    if status is None:
        return WorkerDied(
            f"worker {module} had no result after {timeout_s:g} seconds and was stopped",
            hint=f"If it needs longer, give --timeout SECONDS. {tail}",
        )
    died = WorkerDied(f"worker {module} ended with {ending(status)} and no result", hint=tail)
    died.by_signal = signal.Signals(-status) if status < 0 else None
    return died


def ending(status: int) -> str:
    """A process's return code in words; negative ones are signals."""
    if status >= 0:
        return f"exit status {status}"
    if -status == signal.SIGKILL:
        return "signal SIGKILL (which the system sends when memory runs out)"
    return f"signal {signal.Signals(-status).name}"


def _tail(log: Path) -> str:
    text = _PROGRESS.sub("", log.read_text(encoding="utf-8", errors="replace"))
    lines = [line for line in text.splitlines() if line.strip()]
    return "\n".join(f"  | {line}" for line in lines[-_TAIL_LINES:]) or "  | (empty)"


def worker_main(
    handle: Callable[[Any, StepReport], object],
) -> None:
    """Run a worker: read the job file, call ``handle(job, progress)``, write the result.

    A job or result that is a dataclass travels as ``typed_json`` has it.

    A ``HarnessError`` is passed to the parent with its class. Any other exception ends the process,
    and its traceback is in the log.
    """
    job_path, result_path = Path(sys.argv[1]), Path(sys.argv[2])
    document = read_json(job_path)
    _die_with(document["parent"] or os.getppid())
    try:
        result: dict[str, object] = {
            "value": to_json(handle(typed_job(handle, document["job"]), _say_progress))
        }
    except HarnessError as error:
        result = {"error": error_values(error)}
    except ImportError as error:
        missing = explained(error)
        if missing is None:
            raise
        result = {"error": error_values(missing)}
    write_json(result_path, result)


def typed_job(handle: Callable[..., object], values: Any) -> Any:
    """The job behind JSON values, if the first argument of its handler is a dataclass.

    Raises:
        DataError: the values are not those of such a job.
    """
    kind: Any = next(iter(get_type_hints(handle).values()), None)
    if not is_dataclass(kind):
        return values
    return from_json(cast("type[Any]", kind), values, "the job", "one")


def _say_progress(done: int, total: int) -> None:
    sys.stdout.write(f"@progress {done}/{total}\n")
    sys.stdout.flush()


def _die_with(parent: int) -> None:
    """End this process when its parent is gone, even if the parent was killed."""
    if sys.platform == "linux":
        # The kernel's own signal also reaches a worker inside one long native call.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_PARENT_POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
