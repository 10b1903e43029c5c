"""The files that a scan's file names: materials and pictures."""

from __future__ import annotations

import re
from pathlib import Path

from harness.core.errors import DataError

_MTLLIB = re.compile(rb"^mtllib[ \t]+(.*\S)", re.MULTILINE)
_MATERIAL = re.compile(r"^\s*newmtl\s", re.IGNORECASE | re.MULTILINE)
_MAP = re.compile(r"^\s*map_kd\s+(.*\S)", re.IGNORECASE | re.MULTILINE)
_PLY_PICTURE = re.compile(rb"^comment TextureFile (.*\S)", re.IGNORECASE | re.MULTILINE)
_HEADER_BYTES = 65_536


def material_files(path: Path) -> list[Path]:
    """The material files that an OBJ names; none for other formats.

    Raises:
        DataError: one is not there.
    """
    if path.suffix.lower() != ".obj":
        return []
    found: list[Path] = []
    for name in dict.fromkeys(_MTLLIB.findall(path.read_bytes())):
        file = path.parent / name.decode("utf-8", errors="replace")
        if not file.is_file():
            raise DataError(f"{path} names a material file that is not there", expected=str(file))
        found.append(file)
    return found


def picture_files(path: Path) -> list[Path]:
    """The pictures that an OBJ's materials or a PLY name, whether they are there or not."""
    if path.suffix.lower() == ".ply":
        with path.open("rb") as stream:
            head = stream.read(_HEADER_BYTES).split(b"end_header")[0]
        names = [name.decode("utf-8", errors="replace") for name in _PLY_PICTURE.findall(head)]
    else:
        names = [line.split()[-1] if has_options else line for line, has_options in _maps(path)]
    return [path.parent / name for name in names]


def maps_with_options(path: Path) -> list[str]:
    """The lines of an OBJ's materials that name a picture together with options such as ``-s``."""
    return [line for line, has_options in _maps(path) if has_options]


def _maps(path: Path) -> list[tuple[str, bool]]:
    """What follows ``map_Kd``, and whether that is more than a name, which may have spaces."""
    lines = dict.fromkeys(line for text in _texts(path) for line in _MAP.findall(text))
    return [(line, line.startswith("-") and not (path.parent / line).is_file()) for line in lines]


def has_one_picture(path: Path) -> bool:
    """Whether a file is an OBJ with one material, and that a picture."""
    text = "\n".join(_texts(path))
    return len(_MATERIAL.findall(text)) == 1 and len(_MAP.findall(text)) == 1


def _texts(path: Path) -> list[str]:
    return [file.read_text(encoding="utf-8", errors="replace") for file in material_files(path)]
