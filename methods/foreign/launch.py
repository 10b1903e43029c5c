"""How a method's command is started: by an interpreter, in a conda environment, in a container."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import MissingPart
from methods.foreign.interpreter import Interpreter, environment_of
from methods.foreign.method_file import MethodFile

_ENGINES = ("docker", "podman")
#: The harness's own settings are nobody else's business, and say where scans lie.
_OURS = "HARNESS_"


@dataclass(frozen=True, slots=True)
class Launch:
    """What stands before a command, and what ``{python}`` is in it.

    Attributes:
        interpreter: The Python outside containers and conda.
        python: What ``{python}`` is filled with.
        conda: Words that enter a conda environment.
        engine: The container engine; empty for none.
        image: The container's image.
    """

    interpreter: Interpreter
    python: str
    conda: tuple[str, ...] = ()
    engine: str = ""
    image: str = ""

    def words(
        self, words: Sequence[str], readable: Sequence[Path] = (), writable: Sequence[Path] = ()
    ) -> list[str]:
        """The whole command; a container sees these folders alone, and no network."""
        if not self.engine:
            return [*self.conda, *words]
        mounts = [f"{folder}:{folder}:ro" for folder in readable]
        mounts += [f"{folder}:{folder}" for folder in writable]
        inside = ["--workdir", str(readable[0])] if readable else []
        return [
            *(self.engine, "run", "--rm", "--init", "--network", "none"),
            *(word for mount in mounts for word in ("--volume", mount)),
            *inside,
            self.image,
            *words,
        ]

    def environment(self) -> dict[str, str]:
        """Environment variables of the command: the harness's without its own settings."""
        ours = {name: text for name, text in os.environ.items() if not name.startswith(_OURS)}
        found = environment_of(self.interpreter, ours)
        # Files beside the script are the method's own, and may be imported.
        del found["PYTHONSAFEPATH"]
        return {**found, "PYTHONDONTWRITEBYTECODE": "1"}


def launch_of(method: MethodFile) -> Launch:
    """How a method is started on this machine.

    Raises:
        MissingPart: no such interpreter, or no conda or container engine.
    """
    if method.image:
        engines = [found for name in _ENGINES if (found := shutil.which(name))]
        if not engines:
            raise MissingPart(
                f"method '{method.name}' runs in a container image, and no engine is installed",
                expected=" or ".join(_ENGINES),
                hint="Install one, or give its method.toml a 'python'",
            )
        return Launch(Interpreter(), "python", engine=engines[0], image=method.image)
    if method.conda:
        conda = os.environ.get("CONDA_EXE") or shutil.which("conda")
        if not conda:
            raise MissingPart(
                f"method '{method.name}' runs in a conda environment, and conda is not installed",
                hint="Install it, or give its method.toml a 'python'",
            )
        words = (conda, "run", "--no-capture-output", "--name", method.conda)
        return Launch(Interpreter(Path("python")), "python", words)
    if method.python is None:
        return Launch(Interpreter(), Interpreter().program)
    program = method.folder / Path(method.python).expanduser()
    if not program.is_file():
        raise MissingPart(
            f"the interpreter of method '{method.name}' is not there",
            got=str(program),
            hint=f"Make it, or change 'python' in {method.path}",
        )
    return Launch(Interpreter(program), str(program))
