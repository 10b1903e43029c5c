"""Which Python runs a method, and what it has: asked once a process, nothing heavy is imported."""

from __future__ import annotations

import functools
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import MissingPart
from methods.foreign.method_file import MethodFile

_LIMIT_S = 60
#: Standard library only, for any Python from 3.8 on. A module's package is where its top-level name
#: leads to; a namespace package has no file of its own, so that the module itself is asked for.
_PROBE = """
import hashlib, importlib.util, json, os, sys
from importlib import metadata
found = {"python": sys.version.split()[0], "missing": [], "versions": {}, "sha256": "", "place": ""}
names = sys.argv[1:]
# It reads the lists of all files that are installed: once.
listed = getattr(metadata, "packages_distributions", dict)()
for name in names:
    try:
        spec = importlib.util.find_spec(name)
    except Exception:
        spec = None
    if spec is None:
        found["missing"].append(name)
        continue
    top = name.split(".")[0]
    for distribution in listed.get(top, []) if listed else [top]:
        try:
            found["versions"][distribution] = metadata.version(distribution)
        except metadata.PackageNotFoundError:
            pass
    if name == names[-1]:
        folder = list(importlib.util.find_spec(top).submodule_search_locations or [])
        root = folder[0] if folder else os.path.dirname(spec.origin)
        files = sorted(
            os.path.join(place, file)
            for place, _, files in os.walk(root) for file in files if file.endswith(".py")
        )
        digest = hashlib.sha256()
        for file in files:
            with open(file, "rb") as stream:
                content = stream.read()
            digest.update(os.path.relpath(file, root).encode() + b"\\0" + content)
        found["sha256"], found["place"] = digest.hexdigest(), root
print("@found " + json.dumps(found))
"""


@dataclass(frozen=True, slots=True)
class Interpreter:
    """A Python, and folders that are put before its own path.

    Attributes:
        python: The program; None is the one that runs this.
        path: Folders, such as a source checkout that is not installed.
    """

    python: Path | None = None
    path: tuple[Path, ...] = ()

    @property
    def program(self) -> str:
        """What is started."""
        return str(self.python) if self.python else sys.executable

    @property
    def is_foreign(self) -> bool:
        """Whether it is another one than the harness's own."""
        return self.python is not None

    def packages(self, name: str, modules: tuple[str, ...], install: str) -> Packages:
        """What it has of the modules that a method needs; asked once a process.

        Args:
            name: Of the method, for messages.
            modules: The digest is that of the last one's package.
            install: The next command where something is missing.

        Raises:
            MissingPart: no such interpreter, one that does not run, or modules that it lacks.
        """
        return _packages(self, name, modules, install)


@dataclass(frozen=True, slots=True)
class Packages:
    """What an interpreter has for a method.

    Attributes:
        python: Its version.
        versions: Versions of the modules' distributions, by name, where they are installed as such.
        sha256: Digest of all Python files of the last module's package.
        place: Where that package lies.
    """

    python: str
    versions: Mapping[str, str]
    sha256: str
    place: str

    @property
    def text(self) -> str:
        """A few words for a record."""
        versions = ", ".join(f"{name} {version}" for name, version in sorted(self.versions.items()))
        return f"Python {self.python}{f', {versions}' if versions else ''}"


def environment_of(interpreter: Interpreter, base: Mapping[str, str]) -> dict[str, str]:
    """The environment variables of a method: those of the harness, with the interpreter's path.

    A foreign interpreter does not get ours: packages that are on it would hide its own.
    """
    own = {} if interpreter.is_foreign else {"PYTHONPATH": base.get("PYTHONPATH", "")}
    rest = {
        name: text
        for name, text in base.items()
        if name not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "__PYVENV_LAUNCHER__")
    }
    folders = [str(folder) for folder in interpreter.path]
    joined = ":".join([*folders, *filter(None, [own.get("PYTHONPATH", "")])])
    # The working folder may contain modules with the names of others; ignored before Python 3.11.
    return {**rest, "PYTHONSAFEPATH": "1", **({"PYTHONPATH": joined} if joined else {})}


@functools.lru_cache
def _packages(
    interpreter: Interpreter, name: str, modules: tuple[str, ...], install: str
) -> Packages:
    try:
        process = subprocess.run(
            [interpreter.program, "-c", _PROBE, *modules],
            capture_output=True,
            text=True,
            timeout=_LIMIT_S,
            check=False,
            env=environment_of(interpreter, os.environ),
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise MissingPart(
            f"the interpreter of '{name}' does not run: {interpreter.program}",
            got=str(error),
            hint=f"Run: {install}",
        ) from error
    lines = [line for line in process.stdout.splitlines() if line.startswith("@found ")]
    if process.returncode or not lines:
        tail = (process.stderr.strip().splitlines() or [f"exit status {process.returncode}"])[-1]
        raise MissingPart(
            f"the interpreter of '{name}' does not run: {interpreter.program}",
            got=tail,
            hint=f"Run: {install}",
        )
    found = json.loads(lines[-1].removeprefix("@found "))
    if found["missing"]:
        raise MissingPart(
            f"{interpreter.program} does not have what '{name}' needs",
            expected=", ".join(modules),
            got=f"no {', '.join(found['missing'])}",
            hint=f"Run: {install}",
        )
    return Packages(found["python"], found["versions"], found["sha256"], found["place"])


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
