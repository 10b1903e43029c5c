"""The files of a scan with one material: what is there, and what its OBJ names and is missing."""

from __future__ import annotations

import mmap
import re
from collections.abc import Mapping
from pathlib import Path

from harness.core.errors import DataError
from harness.core.formats.mtl import texture_image
from harness.data.file_checks import FileCheck, check_file, name_below
from harness.data.thuman import find_subject

_MTLLIB = re.compile(rb"^mtllib[ \t]+(.*\S)", re.MULTILINE)


def check_scan(root: Path, subject: str, *, sha256: Mapping[str, str]) -> list[FileCheck]:
    """A scan's mesh, material files and picture, each with its state.

    Args:
        root: The dataset's folder.
        subject: One of its ids.
        sha256: Expected checksums by path below the root, where there are any.
    """
    try:
        mesh = find_subject(root, subject).mesh
    except DataError:
        return [FileCheck(f"model/{subject}/{subject}.obj", "missing")]
    found = [check_file(mesh, root, sha256)]
    if found[0].state != "present":
        return found
    materials = _materials(mesh)
    found += [check_file(mesh.parent / name, root, sha256) for name in materials]
    if not materials:
        note = "names no material file, so that it has no texture"
        return [FileCheck(found[0].path, "corrupt", note)]
    if any(entry.state != "present" for entry in found):
        return found
    try:
        picture = texture_image(mesh, materials)
    except DataError as error:
        return [*found, FileCheck(name_below(root, mesh.parent), "missing", str(error))]
    return [*found, check_file(picture, root, sha256)]


def _materials(mesh: Path) -> list[str]:
    """The material files that an OBJ names, anywhere in it."""
    with (
        mesh.open("rb") as stream,
        mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content,
    ):
        names = _MTLLIB.findall(content)
    return list(dict.fromkeys(name.decode("utf-8", errors="replace") for name in names))
