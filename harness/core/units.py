"""Units that a number may carry."""

from __future__ import annotations

from enum import Enum

__all__ = ["MM_PER_METRE", "Unit"]

MM_PER_METRE = 1000.0


class Unit(str, Enum):
    """A unit's symbol as printed in tables and files."""

    millimetre = "mm"
    degree = "deg"
    ratio = "ratio"
    percent = "%"
    none = "1"
