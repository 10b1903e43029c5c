"""``method.toml`` of a whole method: photos in a folder, a command, one mesh file.

    name = "voxel-carving"
    title = "Voxel carving in one file"
    licence = "Apache-2.0"
    command = ["{python}", "run.py", "--photos", "{photos}", "--out", "{mesh}"]
    python = ".venv/bin/python"                       # or conda = "NAME", or image = "NAME"
    privileges = ["known_cameras", "exact_masks"]
    views = [0, 2, 4, 6]                              # counted from the front; all without it
    deterministic = true
    [settings.carve]
    voxel_m = 0.02

A worker of a method that runs here has another form (``methods.foreign.method_file``).
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import TypeVar

from harness.core.errors import DataError
from harness.core.files.names import NAME_RULE, is_name
from harness.core.files.reach import named_path
from harness.core.protocols import Privilege
from harness.core.typed_json import from_json, to_json
from harness.files.mesh_files import MESH_SUFFIXES

T = TypeVar("T")
MANIFEST = "method.toml"
#: What a command may have filled in.
WORDS = ("python", "start", "parent", "script", "request", "answer")
_COMMAND = ("{python}", "{start}", "{parent}", "{script}", "{request}", "{answer}")


@dataclass(frozen=True, slots=True)
class Worker:
    """One worker.

    Attributes:
        name: What it is called in messages.
        folder: Where its ``method.toml`` lies.
        script: The one file that runs, in that folder.
        modules: What has to be importable; the digest of the last one's package is recorded.
        install: How the user gets these.
        licence: Licence of the last module's package.
        command: Its words.
    """

    name: str
    folder: Path
    script: str
    modules: tuple[str, ...]
    install: str
    licence: str
    command: tuple[str, ...] = _COMMAND

    @property
    def script_path(self) -> Path:
        """The file that runs, which lies in the folder."""
        return named_path(self.folder / MANIFEST, self.script)

    def words(self, filled: Mapping[str, str]) -> list[str]:
        """The command with the words in braces filled in."""
        found: list[str] = []
        for word in self.command:
            for name, text in filled.items():
                word = word.replace(f"{{{name}}}", text)
            found.append(word)
        return found


def read_worker(folder: Path) -> Worker:
    """The worker that a folder's ``method.toml`` describes.

    Raises:
        DataError: no such file, not TOML, or entries that are missing, unknown or of another type.
    """
    path = folder / MANIFEST
    worker = read_described(Worker, path, "a description of a worker")
    _check_command(path, worker)
    return worker


def read_described(kind: type[T], path: Path, noun: str) -> T:
    """What a TOML file describes: a dataclass whose ``folder`` is that of the file.

    Raises:
        DataError: no such file, not TOML, or entries that are missing, unknown or of another type.
    """
    try:
        entries = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path} is not TOML: {error}") from error
    if "folder" in entries:
        raise DataError(f"{path} is not {noun}", got="an entry 'folder'")
    left: dict[str, object] = {"folder": str(path.parent)}
    for each in fields(kind):  # pyright: ignore[reportArgumentType]
        if each.default is not MISSING:
            left[each.name] = to_json(each.default)
        elif each.default_factory is not MISSING:
            left[each.name] = to_json(each.default_factory())
    return from_json(kind, {**left, **entries}, path, noun)


def _check_command(path: Path, worker: Worker) -> None:
    if not worker.script_path.is_file():
        raise DataError(f"{path} names a script that is not there", got=worker.script)
    left = worker.words(dict.fromkeys(WORDS, ""))
    if any("{" in word for word in left):
        raise DataError(
            f"{path} has a command with unknown words",
            expected=", ".join(f"{{{word}}}" for word in WORDS),
            got=" ".join(worker.command),
        )
    for needed in ("{request}", "{answer}"):
        if not any(needed in word for word in worker.command):
            raise DataError(f"the command in {path} does not take {needed}")


METHOD_FILE = MANIFEST
Value = bool | int | float | str

#: Words of a command that are filled in for each subject; both of the first are needed.
_NEEDED = ("photos", "mesh")
_WORDS = (*_NEEDED, "python", "folder", "seed")
_BRACES = re.compile(r"\{([^{}]*)\}")
_ROOM = re.compile(r"[a-z][a-z0-9_]*")
#: What stands before a command must not be taken for an option of conda or of a container engine.
_CONDA = re.compile(r"\w[\w.+-]*", re.ASCII)
_IMAGE = re.compile(r"[a-z0-9][\w.:/@-]*", re.ASCII)
_PROGRAM = re.compile(r"(?!-)(?:\{(?:python|folder)\}|[^{}])+")
_UPS = ("+y", "+z")
#: What only a method in this process can be handed.
_NOT_LENT = (Privilege.GROUND_TRUTH_MESH, Privilege.ORACLE_NORMALS, Privilege.MADE_ELSEWHERE)


@dataclass(frozen=True, slots=True)
class MethodFile:
    """A method that runs in an environment of its own.

    Attributes:
        folder: Where its ``method.toml`` lies; the command runs there.
        name: The name on the command line.
        title: The name in tables.
        licence: Of the method's code and weights.
        command: Its words; ``{photos}`` and such are filled in.
        version: What the method calls itself, for readers.
        python: An interpreter, in the folder if relative; None leaves the harness's own.
        conda: Name of a conda environment; empty for none.
        image: Name of a container image; empty for none.
        views: As in ``MethodInfo``.
        view_count: As in ``MethodInfo``.
        privileges: What it is given beyond pixels.
        needs_perspective: As in ``MethodInfo``.
        trained_on: As in ``MethodInfo``.
        deterministic: Whether the seed changes nothing.
        mesh: Name of the mesh file that it writes.
        up: The vertical axis of poses and mesh: ``+y`` (the subject faces +Z) or ``+z`` (it faces
            -Y, as in Blender and nerfstudio).
        settings: What a user may change, by room.
    """

    folder: Path
    name: str
    title: str
    licence: str
    command: tuple[str, ...]
    version: str = ""
    python: str | None = None
    conda: str = ""
    image: str = ""
    views: tuple[int, ...] | None = None
    view_count: int | None = None
    privileges: tuple[Privilege, ...] = ()
    needs_perspective: str = ""
    trained_on: tuple[str, ...] = ()
    deterministic: bool = False
    mesh: str = "mesh.ply"
    up: str = "+y"
    settings: Mapping[str, Mapping[str, Value]] = field(
        default_factory=dict[str, Mapping[str, Value]]
    )

    @property
    def path(self) -> Path:
        """The file itself."""
        return self.folder / METHOD_FILE

    @property
    def uses_seed(self) -> bool:
        """Whether the command is given a seed."""
        return any("{seed}" in word for word in self.command)

    def words(self, filled: Mapping[str, str]) -> list[str]:
        """The command with the words in braces filled in."""
        return [_BRACES.sub(lambda found: filled[found[1]], word) for word in self.command]


def read_method(path: Path) -> MethodFile:
    """The method that a ``method.toml``, or the folder with one, describes.

    Raises:
        DataError: no such file, not TOML, or entries that are missing, unknown or of another type.
    """
    path = path / METHOD_FILE if path.is_dir() else path
    if path.name != METHOD_FILE:
        raise DataError(f"{path} does not describe a method", expected=f"a file {METHOD_FILE}")
    place = path.parent.resolve() / path.name
    method = read_described(MethodFile, place, "a description of a method")
    if problem := _problem(method):
        raise DataError(f"{path} does not describe a method that can run: {problem}")
    return method


def _problem(method: MethodFile) -> str:
    """What is wrong with entries that are each of the right type; empty where nothing is."""
    places = [bool(method.python), bool(method.conda), bool(method.image)]
    shown = {"title": method.title, "licence": method.licence, "version": method.version or "-"}
    unshown = [name for name, text in shown.items() if not text or not text.isprintable()]
    rooms = {name for room, own in method.settings.items() for name in (room, *own)}
    lent = [each.value for each in method.privileges if each in _NOT_LENT]
    settings = [f"{room}.{name}" for room, own in method.settings.items() for name in own]
    given = [*method.command, *(str(v) for own in method.settings.values() for v in own.values())]
    words = [word for text in method.command for word in _BRACES.findall(text)]
    unknown = [word for word in words if word not in (*_WORDS, *settings)]
    left = [word for word in _NEEDED if word not in words]
    problems = {
        f"{', '.join(unshown)} must be a line of text": bool(unshown),
        "settings must be named in small letters, such as voxel_m below [settings.carve]": any(
            not _ROOM.fullmatch(name) for name in rooms
        ),
        "no command and no setting may hold nan, inf or a zero byte": any(
            "\0" in text or text in ("nan", "inf", "-inf") for text in given
        ),
        f"'{method.name}' cannot be a name ({NAME_RULE})": not is_name(method.name),
        "give one of python, conda and image": sum(places) > 1,
        f"a foreign process cannot be given {', '.join(lent)}": bool(lent),
        "give views or view_count, not both": method.views is not None
        and method.view_count is not None,
        "views must be distinct, from 0 on": method.views is not None
        and (
            not method.views or min(method.views) < 0 or len(set(method.views)) < len(method.views)
        ),
        "view_count must be at least 1": method.view_count is not None and method.view_count < 1,
        f"the command has unknown words {', '.join(f'{{{word}}}' for word in unknown)}": bool(
            unknown
        ),
        f"the command does not take {', '.join(f'{{{word}}}' for word in left)}": bool(left),
        "deterministic says that there is no seed, and the command takes {seed}": (
            method.deterministic and method.uses_seed
        ),
        f"mesh must be a file name that ends in {' '.join(MESH_SUFFIXES)}": Path(method.mesh).name
        != method.mesh
        or Path(method.mesh).suffix not in MESH_SUFFIXES,
        f"up must be {' or '.join(_UPS)}": method.up not in _UPS,
        f"{method.conda!r} cannot be the name of a conda environment": bool(method.conda)
        and not _CONDA.fullmatch(method.conda),
        f"{method.image!r} cannot be the name of a container image": bool(method.image)
        and not _IMAGE.fullmatch(method.image),
        f"the command must begin with a program, not with {''.join(method.command[:1])!r}": (
            not _PROGRAM.fullmatch("".join(method.command[:1]))
        ),
    }
    return "; ".join(text for text, is_so in problems.items() if is_so)
