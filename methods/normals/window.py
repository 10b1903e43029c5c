"""The part of a picture that a network works on.

Networks halve their pictures up to five times, so a window's sides are multiples of 32. A network
that is trained on windows around the subject sees the same whether the subject stands in the middle
of the picture or at its border, and does not work on what is empty.
"""

from __future__ import annotations

from harness.core.arrays import Mask
from harness.geometry.window import Window, rounded_up

#: Least number of pixels between the subject and the window's border.
MARGIN_PX = 16
#: Sides of what a network works on are multiples of this.
MULTIPLE = 32


def mask_window(mask: Mask) -> Window:
    """The window around a mask (H, W) that is true somewhere, ``MARGIN_PX`` free on every side.

    What rounding adds is shared between both sides; the right and lower get an odd pixel more.
    """
    box = Window.around(mask).grown(MARGIN_PX)
    sides = (rounded_up(side, MULTIPLE) for side in box.size)
    return box.about_its_middle(*sides, odd_pixel="last")


def whole_window(size: tuple[int, int]) -> Window:
    """The window of a whole picture (width, height), enlarged to the right and below."""
    width, height = (rounded_up(side, MULTIPLE) for side in size)
    return Window(0, 0, width, height)
