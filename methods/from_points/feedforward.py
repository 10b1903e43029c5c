"""``vggt8``, ``vggt2``, ``da3-8`` and ``mapanything8``: networks that see all photos at once.

Each gives depth and cameras in one pass; the rest is the same for all sources of points. They run
in the user's own installation, with the user's own weights.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

from methods.feedforward.kin import DepthAnything3, MapAnything, Vggt
from methods.feedforward.parts import Find, find_da3, find_mapanything, find_vggt
from methods.feedforward.source import Dialect, NetworkSettings, NetworkSource
from methods.points.method import PointsMethod
from methods.publications.deviations import VGGT_ROW
from methods.publications.published import Published

_RING = tuple(range(8))
_FRONT_BACK = (0, 4)


def _method(
    name: str,
    views: tuple[int, ...],
    source: tuple[Dialect, Find],
    settings: NetworkSettings,
    published: Published | None = None,
) -> PointsMethod:
    network = NetworkSource(*source, settings, len(views))
    return PointsMethod(name, views, network, published=published)


_VGGT = (Vggt(), find_vggt)

vggt8 = _method("vggt8", _RING, _VGGT, NetworkSettings(), VGGT_ROW)
vggt2 = _method("vggt2", _FRONT_BACK, _VGGT, NetworkSettings())
da3_8 = _method("da3-8", _RING, (DepthAnything3(), find_da3), NetworkSettings(side=504, fit="fit"))
mapanything8 = _method(
    "mapanything8", _RING, (MapAnything(), find_mapanything), NetworkSettings(fit="fit")
)
