"""Where Blender is: a module of this Python or another one's, or the user's own program.

Blender's module exists for few versions of Python. Workers that need it run in a process of their
own anyway, which may be another interpreter's: they need our packages and numpy, and no more.
"""

from __future__ import annotations

import functools
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from harness.core.errors import MissingPart
from harness.core.missing import how_to_install
from harness.core.process.source_digest import installed_version

#: Variables that name an interpreter with Blender's module, and the program.
PYTHON_VARIABLE, PROGRAM_VARIABLE = "HARNESS_BLENDER_PYTHON", "HARNESS_BLENDER"
_OLDEST = (4, 2)
_TIMEOUT_S = 60
#: Modules that a worker of Blender's may import, besides those of its own package.
_PACKAGES = ("harness", "renderers")
_VERSION_PROGRAM = "import importlib.metadata as m; print(m.version('bpy'))"
#: What runs a worker's module in an interpreter that does not have our packages.
_ENTRY = """\
import runpy
import sys

sys.path.insert(0, {folder!r})
sys.argv = [{module!r}, *sys.argv[sys.argv.index("--") + 1 :]]
runpy.run_module({module!r}, run_name="__main__", alter_sys=True)
"""


@dataclass(frozen=True, slots=True)
class Blender:
    """One way to run Blender.

    Attributes:
        command: What starts a script in it, up to the script; empty for this interpreter.
        version: Blender's.
        place: Where it is, in words.
    """

    command: tuple[str, ...]
    version: str
    place: str

    def worker(self, module: str) -> BlenderWorker:
        """A module that ends in ``worker_main(handle)``, to be run in this Blender."""
        return BlenderWorker(module, self.command)


@dataclass(frozen=True, slots=True)
class BlenderWorker:
    """A module that runs as a program in some interpreter.

    Attributes:
        module: Dotted name.
        command: As ``Blender.command``.
    """

    module: str
    command: tuple[str, ...] = ()

    def start(self, folder: Path) -> list[str]:
        """The command that runs the module, up to the module's own arguments.

        Args:
            folder: Where a script and links to our packages may be written.
        """
        module = self.module
        if not self.command:
            # -P keeps the working folder off the path: it may contain packages with our names.
            return [sys.executable, "-P", "-m", module]
        # Links to these alone: what else is installed for this Python is nothing for another one.
        packages = folder / "packages"
        packages.mkdir(exist_ok=True)
        for name in {*_PACKAGES, module.partition(".")[0]}:
            spec = find_spec(name)
            assert spec is not None
            assert spec.submodule_search_locations is not None
            (packages / name).symlink_to(next(iter(spec.submodule_search_locations)))
        entry = folder / "start.py"
        entry.write_text(_ENTRY.format(folder=str(packages), module=module), encoding="utf-8")
        return [*self.command, str(entry), "--"]


def find_blender() -> Blender:
    """The Blender that is used: the one that a variable names, the module here, or the program.

    Raises:
        MissingPart: there is none, it does not answer, or it is too old.
    """
    named = os.environ.get(PYTHON_VARIABLE, ""), os.environ.get(PROGRAM_VARIABLE, "")
    found = _found(*named, installed_version("bpy"), shutil.which("blender") or "")
    numbers = tuple(int(number) for number in re.findall(r"\d+", found.version)[:2])
    if numbers < _OLDEST:
        raise MissingPart(
            f"Blender {found.version} of {found.place} is too old",
            expected=f"{_OLDEST[0]}.{_OLDEST[1]} or newer",
            hint=f"Name another one with {PROGRAM_VARIABLE}",
        )
    return found


@functools.cache
def _found(python: str, program: str, module_version: str, on_path: str) -> Blender:
    if python:
        version = _answer([python, "-E", "-P", "-c", _VERSION_PROGRAM], PYTHON_VARIABLE)
        return Blender((python, "-E", "-P"), version, f"the module bpy of {python}")
    if not program and module_version:
        return Blender((), module_version, "the module bpy")
    if program or on_path:
        told = _answer([program or on_path, "--version"], PROGRAM_VARIABLE)
        options = ("--background", "--factory-startup", "--python-exit-code", "1", "--python")
        version = next(iter(re.findall(r"\d+\.\d+[\d.]*", told)), "0.0")
        return Blender((program or on_path, *options), version, program or on_path)
    install = f"Run: {how_to_install('bpy')}" if sys.version_info[:2] == (3, 11) else "Install it"
    raise MissingPart(
        "Blender is not installed",
        hint=f"{install}; or name a Python that has bpy with {PYTHON_VARIABLE}, or the program "
        f"with {PROGRAM_VARIABLE}; or use a recipe with 'renderer: raycast'",
    )


def _answer(command: list[str], variable: str) -> str:
    """What a program says of its version."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=_TIMEOUT_S
        )
    except (OSError, subprocess.SubprocessError) as error:
        said = str(getattr(error, "stderr", "") or error).strip().splitlines() or ["nothing"]
        raise MissingPart(
            f"there is no Blender behind {command[0]}",
            got=said[-1],
            hint=f"Name a Python that has bpy with {PYTHON_VARIABLE}, or the program with "
            f"{PROGRAM_VARIABLE}; this was {variable}",
        ) from error
    return done.stdout.strip()
