"""Hands of the body in place of what the sheets show of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.core.arrays import Mask
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.geometry.surface import SurfaceIndex
from methods.surface.completion import without_vertices

#: The published distance (0.08 in ECON's cube, in which a person is about 1.8 high).
REACH_M = 0.08


def body_hands(body: Mesh, hands: Mask) -> Mesh:
    """The body's hands, open at the wrists.

    Raises:
        MethodError: the body has no hands.
    """
    mesh = without_vertices(body, ~hands)
    if mesh is None:
        raise MethodError("the fitted body has no hands to stand in for those of the sheets")
    return replace(mesh, source="hands")


def without_hands(
    sheets: Sequence[Mesh], body: Mesh, hands: Mask, reach_m: float = REACH_M
) -> list[Mesh]:
    """The sheets without what lies near the body's hands (V,) and is nearest to them.

    A sheet that holds nothing else is left out.
    """
    index = SurfaceIndex(body)
    hand_faces = np.asarray(np.all(hands[body.faces], axis=1))
    kept = []
    for sheet in sheets:
        found, distance = index.closest(sheet.vertices)
        rest = without_vertices(sheet, hand_faces[found.faces] & (distance < reach_m))
        if rest is not None:
            kept.append(rest)
    return kept
