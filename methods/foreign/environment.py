"""What a foreign method's result depends on besides photos: its files, its Python, its packages."""

import functools
import json
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from harness.core.errors import HarnessError, MissingPart
from harness.core.files.hashing import content_hash, file_sha256
from methods.foreign.interpreter import Launch
from methods.foreign.method_file import MethodFile

_LIMIT_S = 120
_MOST_FILES = 5000
#: Where a distribution was installed from a folder of this machine.
_LOCAL = "file://"
_VENV_MARK = "pyvenv.cfg"
#: Folders that a virtual environment has.
_OF_VENV = ("bin", "include", "lib", "lib64", "share", "Include", "Lib", "Scripts")
_NOT_CODE = ("__pycache__", ".git", ".mypy_cache", ".pytest_cache", ".ruff_cache")
#: Standard library only, for any Python from 3.8 on. An editable install has no version to go by.
_PROBE = """
import json, os, platform, sys
from importlib import metadata
found = {"python": platform.python_version(), "implementation": platform.python_implementation(),
         "platform": sys.platform + "-" + platform.machine(), "places": [], "distributions": []}
names = set()
for each in metadata.distributions():
    name, direct = each.metadata["Name"], each.read_text("direct_url.json")
    if name:
        names.add(name.lower() + "==" + each.version + (" " + direct if direct else ""))
found["distributions"] = sorted(names)
found["places"] = [place for place in sys.path if os.path.isdir(place)]
print("@found " + json.dumps(found))
"""


@dataclass(frozen=True, slots=True)
class ForeignEnvironment:
    """Where a method's command runs.

    Attributes:
        python: Implementation and version of its Python; empty for a program that is none.
        platform: System and processor.
        distributions: Name and version of everything that is installed there.
        program: sha256 of the program, or the id of the container image; empty for a Python that is
            known by its version.
    """

    python: str = ""
    platform: str = ""
    distributions: tuple[str, ...] = ()
    program: str = ""

    @property
    def sha256(self) -> str:
        """Content id of all of it."""
        return content_hash(asdict(self))

    def told(self) -> dict[str, object]:
        """Plain JSON values for a record, which does not say where packages lie on this machine."""
        names = [each.partition(" ")[0] if _LOCAL in each else each for each in self.distributions]
        return {**asdict(self), "distributions": names}

    @property
    def text(self) -> str:
        """A few words for a record."""
        if not self.python:
            return f"program {self.program[:12]}"
        return f"{self.python}, {len(self.distributions)} distributions"


def environment_for(method: MethodFile, launch: Launch) -> ForeignEnvironment:
    """The environment as it is now; asked again when what is installed in it has changed.

    Raises:
        MissingPart: the program, interpreter, conda environment or image does not run.
    """
    if not launch.engine and not any("{python}" in word for word in method.command):
        return _without_python(method, launch)
    return _probed(method, launch)


def _probed(method: MethodFile, launch: Launch) -> ForeignEnvironment:
    """What its Python says of itself."""
    words = tuple(launch.words([launch.python, "-c", _PROBE]))
    known = _KNOWN.get(words)
    if known is None or known.stamps != _stamps(known.stamps):
        known = _KNOWN[words] = _asked(method, launch, words)
    return known.environment


@dataclass(frozen=True, slots=True)
class _Known:
    environment: ForeignEnvironment
    stamps: Mapping[str, int]


#: What interpreters answered in this process, with the state of the folders that they look into.
_KNOWN: dict[tuple[str, ...], _Known] = {}


def _stamps(places: Mapping[str, int] | Sequence[str]) -> dict[str, int]:
    return {place: _changed_ns(Path(place)) for place in places}


def _changed_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return -1


def _asked(method: MethodFile, launch: Launch, words: Sequence[str]) -> _Known:
    answer = _answer(method, launch, words)
    image = _image_id(method, launch) if launch.engine else ""
    environment = ForeignEnvironment(
        f"{answer['implementation']} {answer['python']}",
        answer["platform"],
        tuple(answer["distributions"]),
        image,
    )
    # Folders of a container are none of this machine's, and its image does not change.
    places = [] if launch.engine else [*answer["places"], launch.python]
    return _Known(environment, _stamps(places))


def _answer(method: MethodFile, launch: Launch, words: Sequence[str]) -> dict[str, Any]:
    said = _run(method, launch, words)
    lines = [line for line in said.splitlines() if line.startswith("@found ")]
    if not lines:
        raise _broken(method, words[0], "no answer")
    return json.loads(lines[-1].removeprefix("@found "))


def _image_id(method: MethodFile, launch: Launch) -> str:
    words = [launch.engine, "image", "inspect", "--format", "{{.Id}}", launch.image]
    return _run(method, launch, words).strip()


def _run(method: MethodFile, launch: Launch, words: Sequence[str]) -> str:
    try:
        process = subprocess.run(
            words,
            capture_output=True,
            text=True,
            timeout=_LIMIT_S,
            check=False,
            env=launch.environment(),
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise _broken(method, words[0], str(error)) from error
    if process.returncode:
        lines = process.stderr.strip().splitlines()
        raise _broken(method, words[0], lines[-1] if lines else f"exit status {process.returncode}")
    return process.stdout


def _broken(method: MethodFile, program: str, got: str) -> MissingPart:
    return MissingPart(
        f"the environment of method '{method.name}' does not run: {program}",
        got=got,
        hint=f"Repair it, or change 'python', 'conda' or 'image' in {method.path}",
    )


def _without_python(method: MethodFile, launch: Launch) -> ForeignEnvironment:
    """That of a command which does not name its Python: the program, and what it may call."""
    if launch.conda:
        # Its programs, and all packages with their builds, whatever language they are of.
        words = [launch.conda[0], "list", "--export", "--name", method.conda]
        lines = map(str.strip, _run(method, launch, words).splitlines())
        packages = (line for line in lines if not line.startswith("#"))
        return ForeignEnvironment("conda", "", tuple(sorted(filter(None, packages))))
    program = _program(method)
    if method.python is None:
        return program
    return replace(_probed(method, launch), program=program.program)


def _program(method: MethodFile) -> ForeignEnvironment:
    """That of a command that is no Python: the program itself."""
    word = method.command[0].replace("{folder}", str(method.folder))
    beside = method.folder / word
    found = str(beside) if beside.is_file() else shutil.which(word)
    if found is None:
        raise _broken(method, word, "no such program")
    return ForeignEnvironment(program=file_digest(Path(found).resolve()))


def files_sha256(folder: Path, name: str) -> str:
    """Content id of all files in a method's folder; an interpreter in there does not count.

    Raises:
        HarnessError: more files than a method's folder has.
    """
    found: dict[str, object] = {}
    for path in _files(folder):
        found[path.relative_to(folder).as_posix()] = file_digest(path)
        if len(found) > _MOST_FILES:
            raise HarnessError(
                f"the folder of method '{name}' has more than {_MOST_FILES} files",
                got=str(folder),
                hint="Give the method a folder of its own, since all files in it count",
            )
    return content_hash(found)


def file_digest(path: Path) -> str:
    """sha256 of a file, read again when it has changed."""
    return _digest(path, _stamp(path))


def _files(folder: Path) -> Iterator[Path]:
    seen: set[Path] = set()
    for name, below, files in os.walk(folder, followlinks=True):
        place = Path(name).resolve()
        # A virtual environment counts by what is installed in it.
        is_venv = _VENV_MARK in files
        if place in seen or (is_venv and Path(name) != folder):
            below.clear()
            continue
        seen.add(place)
        if is_venv:
            # The method's own folder was made one: its files lie beside the environment's.
            below[:] = [each for each in below if each not in _OF_VENV]
            files.remove(_VENV_MARK)
        below[:] = sorted(each for each in below if each not in _NOT_CODE)
        for file in sorted(files):
            path = Path(name, file)
            if path.suffix != ".pyc" and path.is_file():
                yield path


def _stamp(path: Path) -> tuple[int, int, int]:
    found = path.stat()
    return found.st_ino, found.st_mtime_ns, found.st_size


@functools.lru_cache(maxsize=2 * _MOST_FILES)
def _digest(path: Path, _changed: tuple[int, int, int]) -> str:
    return file_sha256(path)
