"""Commands of tests that start at once: in forks of a process that has imported what they need."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from harness.core.process import forks

TIMEOUT_S = 300


class ForkServer(forks.ForkServer):
    """As the bench's own, with a run's output in files."""

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

        As ``start``; ``output`` and ``errors`` may be one file, which is written on.
        """
        with output.open("ab") as out, errors.open("ab") as error:
            started = self.start(
                target,
                arguments,
                output=out,
                errors=error,
                folder=folder,
                environment=environment,
            )
            try:
                return started.wait(TIMEOUT_S)
            except subprocess.TimeoutExpired as late:
                started.kill()
                raise RuntimeError(f"no end of: {target} {' '.join(arguments)}") from late
