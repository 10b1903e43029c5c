"""Packages that only some executors need."""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType

from harness.core.errors import MissingPart


def extra_package(package: str, version: str, purpose: str) -> ModuleType:
    """A package of an extra, imported now: it takes a second, and most runs do without.

    Args:
        package: Its name.
        version: The one that this program is tested with.
        purpose: What it is needed for, as the beginning of a sentence.

    Raises:
        MissingPart: it is not installed.
    """
    if importlib.util.find_spec(package) is None:
        raise MissingPart(
            f"{purpose} needs the package '{package}', which is not installed",
            hint=f"Run: pip install {package}=={version}",
        )
    return importlib.import_module(package)
