"""A view's maps as a result holds them.

Apart from ``view_maps``, which the body fit uses as well: how normal maps are scored counts for the
methods whose code names ``NormalMaps``, and only for them.
"""

from harness.core.artifacts import NormalMaps
from methods.normals.view_maps import ViewMaps, filled_normals


def result_maps(maps: ViewMaps) -> NormalMaps:
    """A view's maps for others to measure; the body's reach as far as the estimate's."""
    mask = maps.view.mask
    return NormalMaps(
        view=maps.view.index,
        camera=maps.view.camera,
        mask=mask,
        front=maps.front,
        back=maps.back,
        body_front=filled_normals(maps.body_front, mask),
        body_back=filled_normals(maps.body_back, mask),
    )
