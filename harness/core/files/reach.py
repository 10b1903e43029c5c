"""Paths that a file names: they lead no further than the folders that the user named.

A scan, a camera file or a method may come from a stranger, and what it names is read, copied and
shown. So a path in a file counts from that file's folder, links are followed, and what lies outside
that folder and outside the folders that the user named is refused. What the user named may itself
be a link; a link inside it may not lead out of it.
"""

from __future__ import annotations

import os
from pathlib import Path

from harness.core.errors import DataError

_MOST_SHOWN = 200


def named_path(source: Path, name: str, *folders: Path, base: Path | None = None) -> Path:
    """The path that a file means by a name; whether something is there is not looked at.

    Args:
        source: The file with the name in it; what lies in its folder may be named.
        name: Relative or absolute, as the file has it.
        folders: Further folders that the user named, below which anything may be named.
        base: The folder from which the name counts; ``source``'s by default.

    Raises:
        DataError: it leads out of all these folders, or no file can have this path.
    """
    return inside(source, (base or source.parent) / name, source.parent, *folders)


def inside(source: Path, path: Path, *folders: Path) -> Path:
    """The path itself, if it lies in one of the folders with all links followed.

    Args:
        source: What names it or holds it, for the message.
        path: Of what would be read.
        folders: Where it may lie.

    Raises:
        DataError: it lies elsewhere, or no file can have this path.
    """
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass  # whoever reads it says so
    except (OSError, ValueError) as error:
        raise DataError(
            f"{source} names what cannot be a path",
            got=f"{str(path)[:_MOST_SHOWN]!r} ({error.args[-1]})",
        ) from error
    found = os.path.realpath(path)
    roots = [os.path.realpath(folder) for folder in folders]
    if any(Path(found).is_relative_to(root) for root in roots):
        return path
    both = os.path.commonpath([found, roots[-1]])
    parent = "" if both == os.path.sep else f"name the folder {both}, which holds both, or "
    raise DataError(
        f"{source} names a file outside the folders that were given",
        expected=f"something in {' or '.join(dict.fromkeys(map(str, folders)))}",
        got=str(path) if str(path) == found else f"{path}, which is {found}",
        hint=f"If it belongs there, {parent}copy it into {folders[-1]}",
    )
