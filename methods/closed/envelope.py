"""Cutting off what of a surface lies outside the outlines of photos."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.core.mesh import Mesh
from methods.closed.lattices import contoured, evened, lattice_around, signed_distance
from methods.closed.outlines import SignedOutline, outlines_distance

#: Lattice points that are asked at once, which bounds the memory.
_AT_ONCE = 500_000


def cut_to_outlines(mesh: Mesh, outlines: Sequence[SignedOutline], step_m: float) -> Mesh:
    """The part of what a closed mesh encloses that every outline shows: its largest piece, closed.

    Unlike ``remeshed``, which looks near the surface only, this cuts bulges of any size.

    Args:
        mesh: World metres; it may run through itself.
        outlines: The subject's, in as many photos as there are.
        step_m: Spacing of the lattice on which the surface is made anew, metres.

    Raises:
        MethodError: no part of the mesh is inside all outlines.
    """
    lattice = lattice_around(mesh.bounds, step_m)
    # Beyond the next lattice point a distance is never interpolated.
    field = signed_distance(mesh, lattice, 1.8 * step_m)
    inside = np.argwhere(field > -step_m)
    for first in range(0, len(inside), _AT_ONCE):
        indices = inside[first : first + _AT_ONCE]
        place = tuple(indices.T)
        field[place] = np.minimum(
            field[place], outlines_distance(outlines, lattice.points(indices))
        )
    return evened(contoured(lattice, field, mesh.source))
