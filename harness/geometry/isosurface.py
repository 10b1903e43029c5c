"""The closed surface where a field on a lattice has one value."""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Floats, Singles
from harness.core.mesh import Mesh


def isosurface(
    field: Singles,
    *,
    level: float = 0.0,
    outside: float,
    origin: Floats | float = 0.0,
    step: float = 1.0,
    source: str,
) -> Mesh:
    """The surface around what is above a level, facing outwards; marching cubes.

    Args:
        field: (X, Y, Z) values; some are above the level, and some are not.
        level: The value on the surface.
        outside: A value below the level, which the field has beyond the lattice, so that the
            surface is closed there.
        origin: (3,) place of the lattice's first point.
        step: Between the lattice's points, in the unit of ``origin``.
        source: What the mesh calls itself.
    """
    from skimage.measure import marching_cubes

    padded = np.pad(field, 1, constant_values=outside)
    vertices, faces, _, _ = marching_cubes(padded, level=level, spacing=(step,) * 3)
    placed = vertices.astype(np.float64) + origin - step
    mesh = Mesh(placed, faces, source=source)
    return mesh if mesh.signed_volume >= 0 else Mesh(placed, faces[:, ::-1], source=source)
