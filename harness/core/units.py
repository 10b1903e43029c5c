"""Units that a number may carry; a bare float never leaves a metric."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["MM_PER_METRE", "Quantity", "Unit"]

MM_PER_METRE = 1000.0


class Unit(str, Enum):
    """A unit's symbol as printed in tables and files."""

    millimetre = "mm"
    degree = "deg"
    ratio = "ratio"
    none = "1"


@dataclass(frozen=True, slots=True)
class Quantity:
    """A finite number with its unit."""

    value: float
    unit: Unit

    def __str__(self) -> str:
        return f"{self.value:.3f} {self.unit.value}"
