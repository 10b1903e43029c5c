"""Where a user's own parts are kept."""

from __future__ import annotations

import os
from pathlib import Path


def user_folder(variable: str, name: str) -> Path:
    """The folder that an environment variable names, or one of that name below the data folder.

    The data folder is ``mexecon-harness`` below ``XDG_DATA_HOME``, or below ``~/.local/share``.
    """
    named = os.environ.get(variable)
    if named:
        return Path(named).expanduser().resolve()
    data = Path(os.environ.get("XDG_DATA_HOME", ""))
    # Its specification says that a relative path there counts as none.
    base = data if data.is_absolute() else Path.home() / ".local" / "share"
    return base / "mexecon-harness" / name


def parts_folder() -> Path:
    """The folder of converted parts: ``HARNESS_PARTS``, or ``parts`` below the data folder."""
    return user_folder("HARNESS_PARTS", "parts")
