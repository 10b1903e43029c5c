"""The files of a scan with one material: what is there, and what its OBJ names and is missing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from harness.core.errors import DataError
from harness.core.formats.mtl import material_files, texture_image
from harness.data.file_checks import FileCheck, check_file, name_below
from harness.data.thuman import find_subject


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
    found += [check_file(file, root, sha256) for file in material_files(mesh)]
    if any(entry.state != "present" for entry in found):
        return found
    try:
        picture = texture_image(mesh)
    except DataError as error:
        return [*found, FileCheck(name_below(root, mesh.parent), "missing", str(error))]
    return [*found, check_file(picture, root, sha256)]
