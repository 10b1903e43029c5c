"""How far points are inside the visual hull of several silhouettes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from harness.core.arrays import Floats, Singles
from harness.core.mesh import Mesh


def hull_distance(
    distances_m: Sequence[Callable[[Floats], Floats | Singles]], points: Floats, outside_m: float
) -> Singles:
    """(N,) least signed distance of world points to all silhouettes' cones, metres.

    Positive inside. A point that is further than ``outside_m`` outside one silhouette is not asked
    of the next ones: its value is then an upper bound.

    Args:
        distances_m: For each silhouette, the function that gives the signed distances (N,) of
            world points (N, 3) to its cone, metres, positive inside.
        points: (N, 3) world metres.
        outside_m: See above; not negative.
    """
    distance = np.full(len(points), np.inf, dtype=np.float32)
    asked = np.arange(len(points))
    for distance_m in distances_m:
        distance[asked] = np.minimum(distance[asked], distance_m(points[asked]))
        asked = asked[distance[asked] > -outside_m]
    return distance


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
