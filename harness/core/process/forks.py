"""Programs that start at once: forks of a process that has imported what they need.

Most of what a short program does is to import. A server imports it once and never computes: a child
of a process with several threads could stop at a lock that nobody opens. OpenBLAS's own threads end
before a fork and begin anew in the child, so that a child has as many threads as a fresh process.

Run as a program, this file is the server, and imports nothing of ours: a child imports our code as
it is then. The server ends when the process that started it does, and its children end with it.
"""

import contextlib
import gc
import importlib
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import FrameType
from typing import Any, BinaryIO

#: Longest request, bytes: a program's arguments and variables.
_MOST_BYTES = 2**20
#: What cells import for seconds and that leaves one thread: onnxruntime and Blender do not.
LIBRARIES = ("numpy", "scipy.ndimage", "scipy.sparse.linalg", "scipy.spatial", "open3d", "torch",
             "warp", "trimesh")  # fmt: skip


@dataclass(frozen=True, slots=True)
class ForkedWorker:
    """A worker that uses most of ``LIBRARIES``, and starts in a fork where there is a server.

    Of one that does not, the memory of what it does not use would be told as its own.

    Attributes:
        module: Dotted name of a module that ends in ``worker_main(handle)``.
    """

    module: str


class Fork:
    """A program that runs in a fork, with what is used of ``subprocess.Popen``.

    Attributes:
        pid: Its process.
        returncode: As of ``Popen``: None while it runs, negative after a signal.
    """

    def __init__(self, status: int) -> None:
        self._status, self._text = status, b""
        self.returncode: int | None = None
        while b"\n" not in self._text and self.returncode is None:
            self._read()
        self.pid = int(self._text.partition(b"\n")[0] or 0)

    def poll(self) -> int | None:
        """The return code, or None while it runs."""
        while self.returncode is None and select.select([self._status], [], [], 0)[0]:
            self._read()
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """The return code, when there is one.

        Raises:
            TimeoutExpired: there was none in time, seconds.
        """
        while self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            self._read()
        return self.returncode

    def kill(self) -> None:
        """End it, if it runs."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def _read(self) -> None:
        found = os.read(self._status, 64)
        self._text += found
        if not found:
            # A child does not outlive its server.
            code = self._text.split(b"\n")[1:2] or [b""]
            self.returncode = int(code[0]) if code[0] else -signal.SIGKILL
            os.close(self._status)


class ForkServer:
    """A process that has imported some modules and runs programs in forks of itself.

    Args:
        modules: Dotted names of what it imports; those that are not installed are left out.
    """

    def __init__(self, modules: Sequence[str]) -> None:
        there = [name for name in modules if find_spec(name.partition(".")[0])]
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._process = subprocess.Popen(
            [sys.executable, "-P", __file__, str(theirs.fileno()), *there],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(theirs.fileno(),),
            # Ctrl-C is for the process that has this one.
            process_group=0,
        )
        theirs.close()
        self.pid, self._is_ready = self._process.pid, False

    def is_ready(self) -> bool:
        """Whether it has imported all, and lives; asking does not wait."""
        if self._process.poll() is not None:
            return False
        if not self._is_ready and select.select([self._control], [], [], 0)[0]:
            self._is_ready = self._control.recv(64) == b"ready"
        return self._is_ready

    def start(
        self,
        target: str,
        arguments: Sequence[str],
        *,
        output: BinaryIO,
        errors: BinaryIO,
        folder: Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> Fork:
        """A program that begins to run.

        Args:
            target: A module that runs as ``python -m`` runs it, ``module:function``, called without
                arguments, or a script's path.
            arguments: What follows the program's name.
            output: Where its standard output goes.
            errors: Where its standard error goes; may be ``output``.
            folder: In which it runs; this process's own unless given.
            environment: All variables that it has; this process's own unless given.
        """
        request = {
            "target": target,
            "arguments": list(arguments),
            "folder": str(folder or Path.cwd()),
            "environment": dict(os.environ if environment is None else environment),
        }
        answers, theirs = os.pipe()
        try:
            fds = [theirs, output.fileno(), errors.fileno()]
            self._control.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _MOST_BYTES)
            socket.send_fds(self._control, [json.dumps(request).encode()], fds)
        except BaseException:
            os.close(answers)
            raise
        finally:
            os.close(theirs)
        return Fork(answers)

    def close(self) -> None:
        """End the server and what runs in its forks."""
        self._process.kill()
        self._process.wait()
        self._control.close()


#: One for a process at most, as what it has imported is.
_serving: list[ForkServer] = []
_lock = threading.Lock()


@contextlib.contextmanager
def serving(*, wanted: bool) -> Generator[None]:
    """Programs may start in forks within the block, where this system can and it is wanted.

    The server takes 3 s of a processor, beside what is done, and spares each program about as much.
    """
    if not wanted or _serving or sys.platform != "linux":
        yield
        return
    _serving.append(ForkServer(LIBRARIES))
    try:
        yield
    finally:
        with _lock:
            own = _serving.pop()
        own.close()


def server() -> ForkServer | None:
    """What programs may be forked from now: a server that is still importing is none."""
    with _lock:
        return next((each for each in _serving if each.is_ready()), None)


def _serve(control: socket.socket) -> None:
    """Fork for each request, and say how each child ended, until nobody can ask any more."""
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    # The handler of a signal that is ignored would wake nobody.
    signal.signal(signal.SIGCHLD, _nothing)
    signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    # Collecting garbage would touch, and so copy, all that the children share.
    gc.freeze()
    children: dict[int, int] = {}
    control.send(b"ready")
    while True:
        ready = select.select([control, woken], [], [])[0]
        if woken in ready:
            os.read(woken, 4096)
        for pid in tuple(children):
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                answers = children.pop(pid)
                with contextlib.suppress(BrokenPipeError):
                    os.write(answers, f"{os.waitstatus_to_exitcode(status)}\n".encode())
                os.close(answers)
        if control in ready:
            message, fds, _, _ = socket.recv_fds(control, _MOST_BYTES, 3)
            if not message:
                os._exit(0)
            answers, output, errors = fds
            child = os.fork()
            if not child:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                for unused in (control.fileno(), woken, wake, answers, *children.values()):
                    os.close(unused)
                _run(json.loads(message), output, errors)
            os.close(output)
            os.close(errors)
            children[child] = answers
            with contextlib.suppress(BrokenPipeError):
                os.write(answers, f"{child}\n".encode())


def _nothing(_number: int, _frame: FrameType | None) -> None:
    pass


def _run(request: dict[str, Any], output: int, errors: int) -> None:
    """Carry out a request in this process, and end it as an interpreter would end."""
    code = 1
    try:
        _take_over(request, output, errors)
        code = _exit_code(request["target"])
    except BaseException:  # noqa: BLE001 - this copy of the server ends here, whatever it is
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _take_over(request: dict[str, Any], output: int, errors: int) -> None:
    # Not before: what was asked of the threads so far was asked of OpenBLAS's, which have ended.
    assert len(list(Path("/proc/self/task").iterdir())) == 1
    os.setpgid(0, 0)
    for number, opened in ((1, output), (2, errors)):
        os.dup2(opened, number)
    for opened in {output, errors} - {1, 2}:
        os.close(opened)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    tempfile.tempdir = None
    paths = request["environment"].get("PYTHONPATH", "").split(os.pathsep)
    sys.path[:0] = [path for path in paths if path and path not in sys.path]
    importlib.invalidate_caches()
    sys.argv = [request["target"].partition(":")[0], *request["arguments"]]


def _exit_code(target: str) -> int:
    try:
        module, _, function = target.partition(":")
        if function:
            getattr(importlib.import_module(module), function)()
        elif target.endswith(".py"):
            runpy.run_path(target, run_name="__main__")
        else:
            runpy.run_module(target, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        sys.stderr.write(f"{end.code}\n")
        return 1
    return 0


if __name__ == "__main__":
    for name in sys.argv[2:]:
        importlib.import_module(name)
    _serve(socket.socket(fileno=int(sys.argv[1])))
