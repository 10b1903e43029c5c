"""Colours of a surface from the photos that show it.

``sights`` says what each photo shows of each vertex and how well, ``levelling`` finds the exposure
of each photo and a smooth correction, ``smoothing`` spreads values along the surface and fills
what no photo shows, and ``colouring`` joins them.
"""

from harness.geometry.colours.colouring import coloured
