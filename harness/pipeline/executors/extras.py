"""Packages that only some executors need."""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType

from harness.core.missing import not_installed


def extra_package(package: str, purpose: str) -> ModuleType:
    """A package of an extra, imported now: it takes a second, and most runs do without.

    Args:
        package: Its name.
        purpose: What needs it, as the beginning of a sentence.

    Raises:
        MissingPart: it is not installed.
    """
    if importlib.util.find_spec(package) is None:
        raise not_installed(package, purpose)
    return importlib.import_module(package)
