"""How records name the body models; nothing is loaded for it."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from harness.core.files.hashing import file_sha256
from harness.core.protocols import Part

__all__ = ["body_part"]


def body_part(name: str, model_file: str = "") -> Part:
    """The part of the body model ``anny`` or ``smplx``, with the hash of the user's file."""
    if name == "anny":
        return Part("body model", f"Anny {_version('anny')}".strip(), "Apache-2.0")
    path = Path(model_file)
    sha = file_sha256(path) if model_file and path.is_file() else ""
    return Part("body model", "SMPL-X", "SMPL-X licence (non-commercial)", sha)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
