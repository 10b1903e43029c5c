"""How records name the body models; nothing is loaded for it."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

from harness.core.protocols import Part
from methods.body.models.smplx_part import smplx_part


def body_part(name: str, model_file: str = "") -> Part:
    """The part of the body model ``anny`` or ``smplx``; errors as ``smplx_part``."""
    if name == "anny":
        return Part("body model", f"Anny {_version('anny')}".strip(), "Apache-2.0")
    return smplx_part(model_file)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
