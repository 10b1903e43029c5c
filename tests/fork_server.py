"""Commands that start at once: a process that has imported what they need, and forks for each.

Most of what a test's command does is to import. A server imports it once; each command then runs
in a child of its own, with its own folder, environment, arguments and output, and ends with it. A
child of a process with several threads could stop at a lock that nobody opens, so the server
refuses to have more than one: it computes nothing itself.

Run as a program, this file is the server: requests are lines of JSON on standard input, exit codes
are lines on the file descriptor that is its first argument.
"""

from __future__ import annotations

import importlib
import json
import os
import runpy
import select
import subprocess
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

TIMEOUT_S = 300


class ForkServer:
    """A process that has imported some modules and runs commands in forks of itself.

    Args:
        modules: Dotted names of what it imports.
    """

    def __init__(self, modules: Sequence[str]) -> None:
        self._answers, theirs = os.pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-P", __file__, str(theirs), *modules],
            stdin=subprocess.PIPE,
            pass_fds=(theirs,),
            text=True,
        )
        os.close(theirs)

    def run(
        self,
        target: str,
        arguments: Sequence[str],
        *,
        folder: Path,
        output: Path,
        errors: Path,
        environment: Mapping[str, str] | None = None,
    ) -> int:
        """The exit code of a command; negative where a signal ended it.

        Args:
            target: ``package.module:function``, called without arguments, or a script's path.
            arguments: What follows the program's name.
            folder: In which it runs.
            output: Where its standard output goes.
            errors: Where its standard error goes; may be ``output``.
            environment: All variables that it has; this process's own unless given.
        """
        request = {
            "target": target,
            "arguments": list(arguments),
            "folder": str(folder),
            "output": str(output),
            "errors": str(errors),
            "environment": dict(os.environ if environment is None else environment),
        }
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        ready, _, _ = select.select([self._answers], [], [], TIMEOUT_S)
        line = os.read(self._answers, 64) if ready else b""
        if not line:
            self._process.kill()
            raise RuntimeError(f"no answer of the fork server to: {target} {' '.join(arguments)}")
        return int(line)

    def close(self) -> None:
        """End the server."""
        self._process.kill()
        self._process.communicate()
        os.close(self._answers)


def serve(answers: int) -> None:
    """Run each request in a fork, until there are no more."""
    for line in sys.stdin:
        threads = [int(path.name) for path in Path("/proc/self/task").iterdir()]
        assert threads == [os.getpid()]
        child = os.fork()
        if not child:
            _run(json.loads(line))
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        os.write(answers, f"{code}\n".encode())


def _run(request: dict[str, Any]) -> None:
    """Carry out a request in this process, and end it as an interpreter would end."""
    code = 1
    try:
        _take_over(request)
        code = _exit_code(request["target"])
    except BaseException:  # noqa: BLE001 - this copy of the server ends here, whatever it is
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _take_over(request: dict[str, Any]) -> None:
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    for number, path in ((0, os.devnull), (1, request["output"]), (2, request["errors"])):
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND
        opened = os.open(path, flags, 0o644)
        os.dup2(opened, number)
        os.close(opened)
    paths = request["environment"].get("PYTHONPATH", "").split(os.pathsep)
    sys.path[:0] = [path for path in paths if path]
    importlib.invalidate_caches()
    sys.argv = [request["target"].partition(":")[0], *request["arguments"]]


def _exit_code(target: str) -> int:
    try:
        module, _, function = target.partition(":")
        if function:
            getattr(importlib.import_module(module), function)()
        else:
            runpy.run_path(target, run_name="__main__")
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        print(end.code, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    for name in sys.argv[2:]:
        importlib.import_module(name)
    serve(int(sys.argv[1]))
