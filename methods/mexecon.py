"""``mexecon2``, ``mexecon8``: N photos to a clothed mesh; each sheet from the view that sees it.

The paper's method: one body fitted jointly to all views (JMBO), front normals estimated in the
front and in the back view, the back's turned by the known relative rotation of the cameras.

Under full perspective the two views do not share a pixel grid, so that turned normals alone cannot
be integrated on the front's pixels. As in the authors' code, each view is integrated with the
estimator's maps of both its sides, and only its near sheet is kept; its own camera then takes that
sheet to the world, which is the known rotation and, unlike there, the known translation as well.

Eight views also show how far the clothes stand off the body, all round: ``mexecon8`` holds its
surface to the body moved out to the silhouettes (``methods/surface/clothed_body.py``), where the
paper inflates the body by 2 cm (``--set clothes=uniform``).

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from harness.core.mesh import Mesh
from methods.body_fit import DEFAULT, BodyFit
from methods.normals import ViewMaps
from methods.surface import FrontBackDepth, SheetParameters
from methods.surface.clothed import ClothedMethod, ClothedSettings, SheetPlan
from methods.surface.sheets import depth_sheet

__all__ = ["mexecon2", "mexecon8"]

_FRONT, _BACK = 0, 4


def _near_sides(views: Sequence[tuple[ViewMaps, FrontBackDepth]]) -> list[Mesh]:
    """The near sheet of each view, on that view's pixels."""
    sheets = [
        depth_sheet(depth.front, maps.view.camera, SheetParameters(), away=False)
        for maps, depth in views
    ]
    names = ("front sheet", "back sheet")
    return [replace(sheet, source=name) for sheet, name in zip(sheets, names, strict=True)]


def _mexecon(
    name: str, title: str, views: tuple[int, ...], settings: ClothedSettings
) -> ClothedMethod:
    return ClothedMethod(
        names=(name, title),
        fit=BodyFit(f"{name}-body", f"JMBO, {len(views)} views", views, DEFAULT),
        plan=SheetPlan((_FRONT, _BACK), _near_sides),
        settings=settings,
    )


mexecon2 = _mexecon("mexecon2", "MExECON, 2 views", (_FRONT, _BACK), ClothedSettings())
mexecon8 = _mexecon(
    "mexecon8", "MExECON, 8 views", tuple(range(8)), ClothedSettings(clothes="silhouettes")
)
