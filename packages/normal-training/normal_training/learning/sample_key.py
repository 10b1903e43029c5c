"""What a file of training samples was made from, read without anything else in it."""

from __future__ import annotations

from pathlib import Path

from harness.core.errors import DataError
from harness.core.files.npz import read_array_npz


def stored_key(path: Path) -> str:
    """The content id in a file of training samples; empty if it is absent, damaged or another's."""
    try:
        return str(read_array_npz(path, ["key"]).get("key", ""))
    except DataError:
        return ""
