"""Which of the documented layouts a folder has, and the scan or capture of each subject in it."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path

from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.names import NAME_RULE, inside, is_name
from harness.data.scans import APPEARANCE_SUFFIXES
from harness.files.mesh_files import atlas_of
from harness.files.mtl import Picture, materials_of, picture_file
from harness.geometry.images import check_picture

#: Formats of which colours can be read.
_SUFFIXES = (".obj", ".ply", ".glb")
#: Beside the fits of THuman lies the body of the fit, which is no scan.
FITTED_BODY = "mesh_smplx.obj"
_CAPTURE = "capture.json"
_MOST_SHOWN = 5


class Layout(Enum):
    """A documented layout; the value says what it looks like."""

    tree = "a tree as THuman's (<id>/<id>.obj or model/<id>/<id>.obj)"
    files = "mesh files side by side (<id>.obj, .ply or .glb)"
    folders = "a folder with one mesh file for each subject (<id>/*.obj, .ply or .glb)"
    captures = "captures (<id>/capture.json or <id>/<recipe>/capture.json)"
    named = "a data set of the field, under its name ('harness data add cape DIR')"


@dataclass(frozen=True, slots=True)
class Companions:
    """What belongs to a scan of a data set of the field.

    Attributes:
        files: By kind: ``body``, the surface of its fit; ``labels`` of its vertices or faces;
            ``orientation``, a fit's parameters; others.
        regions: Names of the labels' numbers.
        floor: Height, in units of the file, below which lies what is no person; None: nothing.
    """

    files: Mapping[str, Path] = field(default_factory=dict[str, Path])
    regions: tuple[str, ...] = ()
    floor: float | None = None


@dataclass(frozen=True, slots=True)
class FoundFolder:
    """A folder whose layout is known.

    Attributes:
        root: The folder; of a tree, the one that ``find_subject`` takes.
        layout: What it looks like.
        subjects: Mesh file, or folder of the capture, by id and in order.
        companions: What belongs to each, in a data set of the field.
    """

    root: Path
    layout: Layout
    subjects: Mapping[str, Path]
    companions: Mapping[str, Companions] = field(default_factory=dict[str, Companions])

    def only(self, names: Sequence[str]) -> FoundFolder:
        """The same folder with some of its subjects, in the order given; all if none is named.

        Raises:
            HarnessError: it has no such subject.
        """
        for name in names:
            if name not in self.subjects:
                raise HarnessError(
                    f"{self.root} has no subject '{name}'", hint=did_you_mean(name, self.subjects)
                )
        chosen = {name: self.subjects[name] for name in names} or dict(self.subjects)
        return replace(self, subjects=chosen)


def find_layout(folder: Path) -> FoundFolder:
    """The layout of a folder and its subjects.

    Links are followed, at most three folders deep, so that a circle of links has an end.

    Raises:
        DataError: no such folder, no known layout or more than one, several meshes or captures for
            one subject, an id that is no name, or a link out of the folder.
    """
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder", expected="a folder of scans or captures")
    root = folder.resolve()
    found = [each for each in (_tree(root), _files(root), _folders(root), _captures(root)) if each]
    if len(found) > 1:
        raise DataError(
            f"{folder} has more than one layout",
            expected="one",
            got="; ".join(f"{each.layout.value}: {_some(each.subjects)}" for each in found),
            hint="Move what belongs together into a folder of its own",
        )
    if not found:
        raise DataError(
            f"{folder} has none of the layouts that can be added",
            expected="; ".join(layout.value for layout in Layout),
            got=_some([entry.name for entry in _entries(root)]) or "an empty folder",
            hint=_next_step(root),
        )
    bad = [name for name in found[0].subjects if not is_name(name)]
    if bad:
        raise DataError(
            f"{folder} has subjects whose names cannot be ids: {', '.join(map(repr, bad[:5]))}",
            expected=NAME_RULE,
            hint="Rename these files or folders; the name of a scan becomes its id",
        )
    for path in found[0].subjects.values():
        inside(folder, path, folder)
    return found[0]


def _entries(folder: Path) -> list[Path]:
    """What lies in a folder and is not hidden, in order; nothing if it cannot be listed."""
    try:
        return sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError:
        return []


def _folders_in(folder: Path) -> list[Path]:
    return [path for path in _entries(folder) if path.is_dir()]


def _meshes_in(folder: Path) -> list[Path]:
    return [
        path
        for path in _entries(folder)
        if path.suffix.lower() in _SUFFIXES and path.name != FITTED_BODY and path.is_file()
    ]


def _tree(root: Path) -> FoundFolder | None:
    """As THuman's: the parts of ``find_subject`` that do not search."""
    below = root / "model"
    places = [*_folders_in(root), *(_folders_in(below) if below.is_dir() else [])]
    meshes = {place.name: place / f"{place.name}.obj" for place in places}
    found = {name: mesh for name, mesh in meshes.items() if mesh.is_file()}
    return FoundFolder(root, Layout.tree, found) if found else None


def _files(root: Path) -> FoundFolder | None:
    meshes = _meshes_in(root)
    return _one_each(root, Layout.files, [(mesh.stem, mesh) for mesh in meshes])


def _folders(root: Path) -> FoundFolder | None:
    """Folders with a mesh of any name, but for those that a tree has."""
    meshes = [
        (place.name, mesh)
        for place in _folders_in(root)
        if not (place / f"{place.name}.obj").is_file()
        for mesh in _meshes_in(place)
    ]
    return _one_each(root, Layout.folders, meshes)


def _captures(root: Path) -> FoundFolder | None:
    found: list[tuple[str, Path]] = []
    for place in _folders_in(root):
        folders = [place, *_folders_in(place)]
        found += [(place.name, each) for each in folders if (each / _CAPTURE).is_file()]
    return _one_each(root, Layout.captures, found)


def _one_each(root: Path, layout: Layout, found: Sequence[tuple[str, Path]]) -> FoundFolder | None:
    subjects = dict(found)
    for name in subjects:
        several = [path for each, path in found if each == name]
        if len(several) > 1:
            names = _some([os.path.relpath(path, root) for path in several])
            what = "captures" if layout is Layout.captures else "mesh files"
            raise DataError(
                f"subject '{name}' of {root} has several {what}",
                expected="one",
                got=names,
                hint="Move the others away",
            )
    return FoundFolder(root, layout, subjects) if subjects else None


def _some(names: Sequence[str] | Mapping[str, Path]) -> str:
    shown = list(names)[:_MOST_SHOWN]
    more = len(names) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def _next_step(root: Path) -> str:
    """What to do with a folder that is something else which is known."""
    if (root / _CAPTURE).is_file():
        return "It is one capture: name the folder above it"
    if any(path.suffix.lower() in (".jpg", ".jpeg", ".png") for path in _entries(root)):
        return "Photos with cameras are imported by 'harness capture import'"
    if any((place / FITTED_BODY).is_file() for place in _folders_in(root)):
        return f"It holds fits: {FITTED_BODY} is the body of a fit. Name the folder of the scans"
    if [*root.glob("*.abc"), *root.glob("*/*.abc")]:
        return "Alembic (.abc) is not read: export one frame of it as OBJ or PLY, as Blender does"
    return "See 'Your own scans' in docs/data.md"


#: Modes of pictures that every renderer reads alike.
_MODES = ("RGB", "RGBA", "L", "P")
_PLY_PICTURE = re.compile(rb"^comment[ \t]+TextureFile[ \t]+(.*\S)", re.IGNORECASE | re.MULTILINE)
_HEADER_BYTES = 65_536


def named_files(path: Path, *folders: Path) -> list[Path]:
    """The material files and pictures that an OBJ or a PLY names and shows, in order.

    Args:
        path: The scan's file.
        folders: Further folders in which they may lie.

    Raises:
        DataError: one that lies elsewhere; a material file or a material's picture that is not
            there, or is placed in a way that is not applied.
    """
    if path.suffix.lower() == ".pkl":
        return [file for file in (atlas_of(path),) if file.is_file()]
    if path.suffix.lower() == ".obj":
        materials = materials_of(path, *folders)
        used = [materials.of(name) for name in materials.named or ("",)]
        pictures = [each.picture(path, *folders) if each else None for each in used]
        return [*materials.files, *dict.fromkeys(each.path for each in pictures if each)]
    return ply_pictures(path, *folders) if path.suffix.lower() == ".ply" else []


def ply_pictures(path: Path, *folders: Path) -> list[Path]:
    """The pictures that a PLY names, whether they are there or not, by their number."""
    with path.open("rb") as stream:
        head = stream.read(_HEADER_BYTES).split(b"end_header")[0]
    names = [name.decode("utf-8", errors="replace") for name in _PLY_PICTURE.findall(head)]
    return [picture_file(path, name, path.parent, *folders) for name in names]


def why_converted(path: Path, *folders: Path) -> str:
    """Why an OBJ cannot be read where it lies, in words; empty if it can, or cannot be read at all.

    It can if all its faces show one picture as it is, of a usual kind, and names nothing elsewhere.
    """
    try:
        materials = materials_of(path, *folders)
        found = materials.only_picture(*folders)
        if not isinstance(found, Picture):
            return f"{path.stem} does not show one picture all over, but {found}"
        if not re.search(rb"[\r\n][ \t]*vt[ \t]", path.read_bytes()):
            return f"{path.stem} has a picture, but no texture coordinates"
        mode = check_picture(found.path)
    except DataError:
        # Nor can it be converted: whoever reads it says why.
        return ""
    beside = all(file.parent == path.parent for file in (found.path, *materials.files))
    if beside and found.path.suffix.lower() in APPEARANCE_SUFFIXES and mode in _MODES:
        return ""
    return (
        f"{path.stem} has a picture {found.path.name} of another kind (mode {mode}), or it or its "
        "material file lies elsewhere"
    )
