"""How far points are inside the visual hull of several silhouettes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from harness.core.arrays import Floats, Singles


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
