"""``oracle8-points``: the scan's own depth in eight views, aligned, filtered and meshed as others'.

The ceiling of the family of points, and the self-test of what its methods share.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

from methods.points.method import PointsMethod
from methods.points.rendered import RenderedDepth

__all__ = ["oracle8_points"]

oracle8_points = PointsMethod("oracle8-points", tuple(range(8)), RenderedDepth())
