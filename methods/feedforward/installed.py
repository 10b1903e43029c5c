"""Networks that the user installed: where the weights are, and which Python runs them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from harness.core.protocols import Part
from methods.foreign.interpreter import Interpreter, Packages
from methods.foreign.manifest import Worker


@dataclass(frozen=True, slots=True)
class InstalledNetwork:
    """Weights and an interpreter.

    Attributes:
        title: What the weights are, as records name them.
        licence: The weights' licence.
        sha256: Digest of the weights.
        weights: Their file or folder, as the worker takes it.
        bytes: Their size.
        interpreter: Which Python runs the worker.
    """

    title: str
    licence: str
    sha256: str
    weights: Path
    bytes: int
    interpreter: Interpreter

    def parts(self, worker: Worker) -> tuple[Part, ...]:
        """Weights and package, as records name them.

        Raises:
            MissingPart: the interpreter lacks what the worker needs.
        """
        package: Packages = self.interpreter.packages(worker)
        name = f"{worker.name} ({package.text})"
        return (
            Part("network", self.title, self.licence, self.sha256),
            Part("package", name, worker.licence, package.sha256),
        )


#: Gives the installed network, or raises ``MissingPart`` with the command that installs it.
Find = Callable[[], InstalledNetwork]
