"""Units of numbers, and the one scale that is none."""

from enum import Enum

MM_PER_METRE = 1000.0
#: The scale rule under which a scan keeps its own units and 1 unit counts as 1 m, as the published
#: results were very likely made. Metres and such units never share a table.
UNITS_RULE = "units"


class Unit(str, Enum):
    """A unit's symbol as printed in tables and files."""

    millimetre = "mm"
    degree = "deg"
    ratio = "ratio"
    percent = "%"
    pixel = "px"
    none = "1"
