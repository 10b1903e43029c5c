"""Whether an expected file is there and whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.core.files.hashing import file_sha256


@dataclass(frozen=True, slots=True)
class FileCheck:
    """One expected file: ``present``, ``missing``, ``corrupt`` or ``unreadable``."""

    path: str
    state: str
    note: str = ""


def name_below(root: Path, path: Path) -> str:
    """A file's path below a folder, or its whole path if it lies elsewhere."""
    return str(path.relative_to(root)) if path.is_relative_to(root) else str(path)


def check_file(path: Path, root: Path, sha256: Mapping[str, str], note: str = "") -> FileCheck:
    """A file's state, compared with its checksum where there is one.

    Args:
        path: The file.
        root: The dataset's folder.
        sha256: Expected checksums by path below the root.
        note: What to say of a file that is there and has no checksum.
    """
    name = name_below(root, path)
    if not path.is_file():
        return FileCheck(name, "missing")
    if path.stat().st_size == 0:
        return FileCheck(name, "corrupt", "empty file")
    expected = sha256.get(name)
    if expected is None:
        return FileCheck(name, "present", note)
    found = file_sha256(path)
    if found != expected:
        return FileCheck(name, "corrupt", f"sha256 {found[:12]}…, expected {expected[:12]}…")
    return FileCheck(name, "present", "sha256 agrees")
