"""The files that a scan's file names: materials and pictures."""

from __future__ import annotations

import re
from pathlib import Path

from harness.core.errors import DataError
from harness.core.formats.mtl import Picture, materials_of, picture_file
from harness.data.scans import APPEARANCE_SUFFIXES
from harness.geometry.images import check_picture

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
