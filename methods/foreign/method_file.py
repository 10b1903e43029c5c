"""``method.toml`` of a method: photos in a folder, a command, one result back.

name = "voxel-carving"
title = "Voxel carving in one file"
licence = "Apache-2.0"
command = ["{python}", "run.py", "--photos", "{photos}", "--out", "{result}"]
result = "mesh"                                   # or depth, points, gaussians
python = ".venv/bin/python"                       # or conda = "NAME", or image = "NAME"
privileges = ["known_cameras", "exact_masks"]
views = [0, 2, 4, 6]                              # counted from the front; all without it
deterministic = true
[settings.carve]
voxel_m = 0.02
[recipe]                                          # what a recipe needs from its user
source = "https://example.org/code"
"""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path

from harness.core.errors import DataError
from harness.core.files.names import NAME_RULE, is_name
from harness.core.protocols import Privilege
from harness.core.typed_json import from_json, to_json
from harness.files.mesh_files import MESH_SUFFIXES
from methods.points.cloud import ALIGNMENTS

METHOD_FILE = "method.toml"
Value = bool | int | float | str


def _entries(path: Path, noun: str) -> dict[str, object]:
    try:
        entries = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise DataError(f"no readable file at {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path} is not TOML: {error}") from error
    if "folder" in entries:
        raise DataError(f"{path} is not {noun}", got="an entry 'folder'")
    return entries


def _filled(kind: type[object], entries: Mapping[str, object]) -> dict[str, object]:
    """The entries of a dataclass, with the defaults of those that are not there."""
    left: dict[str, object] = {}
    for each in fields(kind):  # pyright: ignore[reportArgumentType]
        if each.default is not MISSING:
            left[each.name] = to_json(each.default)
        elif each.default_factory is not MISSING:
            left[each.name] = to_json(each.default_factory())
    return {**left, **entries}


#: What a command may have filled in; one of the first, which name its answer, and photos it needs.
_ANSWER = ("result", "mesh")
_WORDS = (*_ANSWER, "photos", "python", "folder", "seed", "weights", "checkout")
#: Kinds of results, and the file that each is by default.
RESULTS = {
    "mesh": "mesh.ply",
    "depth": "depth.npz",
    "points": "points.ply",
    "gaussians": "gaussians.ply",
}
_FRAMES = ("world", "own")
_BRACES = re.compile(r"\{([^{}]*)\}")
_ROOM = re.compile(r"[a-z][a-z0-9_]*")
#: What stands before a command must not be taken for an option of conda or of a container engine.
_CONDA = re.compile(r"\w[\w.+-]*", re.ASCII)
_IMAGE = re.compile(r"[a-z0-9][\w.:/@-]*", re.ASCII)
_PROGRAM = re.compile(r"(?!-)(?:\{(?:python|folder)\}|[^{}])+")
_UPS = ("+y", "+z")
#: What only a method in this process can be handed.
_NOT_LENT = (
    *(Privilege.GROUND_TRUTH_MESH, Privilege.ORACLE_NORMALS),
    *(Privilege.MADE_ELSEWHERE, Privilege.OWN_FRAME),
)


@dataclass(frozen=True, slots=True)
class Download:
    """Something that the user gets.

    Attributes:
        what: Which file or folder.
        get: Where from, and with which registration.
        sha256: Its sum as it is published; empty where nobody publishes one.
    """

    what: str
    get: str
    sha256: str = ""


@dataclass(frozen=True, slots=True)
class Needs:
    """What a recipe needs from its user.

    Attributes:
        source: Where the method's code is.
        commit: Which state of it the recipe was written for; empty for a released package.
        environment: File of pinned packages in the recipe's folder: ``.txt`` for a virtual
            environment, ``.yml`` for conda.
        modules: What its interpreter can import then; a digest of the last one's package is
            recorded, unless there is a checkout.
        checkout: Files that a checkout of the source has, with what was put into it; none where an
            installed package is enough.
        weights: Files that the folder of weights has; none where a file is named.
        network: What the weights are, with their licence; empty where there are none.
        network_licence: Their licence.
        downloads: What the user gets.
        gated: What has to be accepted for that, by a person; empty for nothing.
        gpu_gib: Memory of the GPU that it needs; 0 for none.
        view_gib: Main memory that it needs for each photo of ``network.side`` pixels as set by
            default, besides its weights and 1 GiB; 0 where nobody knows.
        untested: What of it was not run where the recipe was written.
    """

    source: str
    commit: str = ""
    environment: str = ""
    modules: tuple[str, ...] = ()
    checkout: tuple[str, ...] = ()
    weights: tuple[str, ...] = ()
    network: str = ""
    network_licence: str = ""
    downloads: tuple[Download, ...] = ()
    gated: str = ""
    gpu_gib: float = 0.0
    view_gib: float = 0.0
    untested: str = ""


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
        result: What it writes, one of ``RESULTS``.
        mesh: Name of the file that it writes; empty is that of ``RESULTS``.
        frame: ``world``, or ``own`` for a result in a unit and axes of its own.
        align: How the harness may bring its points to metres, the first by default: of
            ``ALIGNMENTS``.
        up: The vertical axis of poses and mesh: ``+y`` (the subject faces +Z) or ``+z`` (it faces
            -Y, as in Blender and nerfstudio).
        settings: What a user may change, by room.
        recipe: What its user has to bring; None for a method that is there.
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
    result: str = "mesh"
    mesh: str = ""
    frame: str = "world"
    align: tuple[str, ...] = ()
    up: str = "+y"
    settings: Mapping[str, Mapping[str, Value]] = field(
        default_factory=dict[str, Mapping[str, Value]]
    )
    recipe: Needs | None = None

    @property
    def answer(self) -> str:
        """Name of the file that it writes."""
        return self.mesh or RESULTS[self.result]

    @property
    def alignments(self) -> tuple[str, ...]:
        """How its points may be brought to metres; the first is the default."""
        if self.align or self.frame == "world":
            return self.align or ("native_posed",)
        return tuple(mode for mode in ALIGNMENTS if mode != "native_posed")

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
    noun = "a description of a method"
    entries = _filled(MethodFile, {"folder": str(place.parent), **_entries(place, noun)})
    if isinstance(needs := entries["recipe"], dict):
        downloads = needs.get("downloads", ())
        if isinstance(downloads, list):
            needs["downloads"] = [
                _filled(Download, each) if isinstance(each, dict) else each for each in downloads
            ]
        entries["recipe"] = _filled(Needs, needs)
    method = from_json(MethodFile, entries, place, noun)
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
    left = [] if "photos" in words else ["photos"]
    left += [] if any(word in words for word in _ANSWER) else ["result"]
    suffixes = (
        MESH_SUFFIXES
        if method.result == "mesh"
        else (Path(RESULTS.get(method.result, ".")).suffix,)
    )
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
        f"result must be {' or '.join(RESULTS)}": method.result not in RESULTS,
        f"frame must be {' or '.join(_FRAMES)}": method.frame not in _FRAMES,
        f"align must be of {', '.join(ALIGNMENTS)}": not {*method.align} <= {*ALIGNMENTS},
        f"mesh must be a file name that ends in {' '.join(suffixes)}": bool(method.mesh)
        and (Path(method.mesh).name != method.mesh or Path(method.mesh).suffix not in suffixes),
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
