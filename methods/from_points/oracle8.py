"""``oracle8-points``: the scan's own depth in eight views, aligned, filtered and meshed as others'.

The ceiling of the family of points, and the self-test of what its methods share. Its surface is
held to the silhouettes: on avatars, bulges that no view's depth sees, such as under the soles, are
most of what plain Poisson reconstruction loses.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

from methods.points.filtering import MeshSettings
from methods.points.method import PointsMethod, PointsRooms
from methods.points.sources import RenderedDepth

oracle8_points = PointsMethod(
    "oracle8-points",
    tuple(range(8)),
    RenderedDepth(),
    PointsRooms(mesh=MeshSettings(silhouettes="held")),
)
