"""``mexecon2``, ``mexecon8``, ``mexecon+two-sheets``: N photos to a mesh of two sheets.

The paper's method: one body fitted jointly to all views (JMBO), front normals estimated in the
front and in the back view, the back's turned by the known relative rotation of the cameras.

Under full perspective the two views do not share a pixel grid, so that turned normals alone cannot
be integrated on the front's pixels. As in the authors' code, each view is integrated with the
estimator's maps of both its sides, and only its near sheet is kept; its own camera then takes that
sheet to the world, which is the known rotation and, unlike there, the known translation as well.

``mexecon+two-sheets`` is ours: ``mexecon+`` (``methods/nview``) without its fusion. Eight views
also show how far the clothes stand off the body, all round: it holds its surface to the body moved
out to the silhouettes (``methods/surface/completion.py``), where the paper inflates the body by
2 cm, and fits that body as ``jmbo8+``.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from collections.abc import Sequence
from dataclasses import replace

from harness.core.mesh import Mesh
from methods.body.settings import ECON_FIT, JMBO, JMBO_PLUS
from methods.body_fit import BodyFit
from methods.clothed import ClothedMethod, ClothedSettings, SheetPlan
from methods.normals import ViewMaps
from methods.publications.completion import ECON, MEXECON, MEXECON_CEILING
from methods.surface import FrontBackDepth, SheetParameters, front_back_sheets
from methods.surface.fusion import depth_sheet

_FRONT, _BACK = 0, 4


def _near_sides(views: Sequence[tuple[ViewMaps, FrontBackDepth]]) -> list[Mesh]:
    """The near sheet of each view, on that view's pixels."""
    sheets = [
        depth_sheet(depth.front, maps.view.camera, SheetParameters(), away=False)
        for maps, depth in views
    ]
    names = ("front sheet", "back sheet")
    return [replace(sheet, source=name) for sheet, name in zip(sheets, names, strict=True)]


_ALL = tuple(range(8))
#: The network's folds are good, but small errors that share a direction add up along a sheet. On
#: sixteen training subjects that it does not know, weights of 1e-4, 3e-4, 1e-3 and 3e-3 gave a mean
#: normal error of 25.3, 25.3, 25.2 and 25.4 degrees at Chamfer distances of 13.5, 13.2, 13.7 and
#: 14.0 mm.
_PRIOR_WEIGHT = 1e-3


def _mexecon(name: str, title: str, views: tuple[int, ...]) -> ClothedMethod:
    return ClothedMethod(
        names=(name, title),
        fit=BodyFit(f"{name}-body", f"JMBO, {len(views)} views", views, JMBO),
        plan=SheetPlan((_FRONT, _BACK), _near_sides),
        settings=ClothedSettings(),
        published=MEXECON,
    )


mexecon2 = _mexecon("mexecon2", "MExECON, 2 views", (_FRONT, _BACK))
mexecon8 = _mexecon("mexecon8", "MExECON, 8 views", _ALL)
oracle8 = ClothedMethod(
    names=("oracle8", "MExECON, 8 views, normals of the scan"),
    fit=BodyFit("oracle8-body", "JMBO, 8 views", _ALL, JMBO),
    plan=SheetPlan((_FRONT, _BACK), _near_sides),
    settings=ClothedSettings(normals="oracle"),
    published=MEXECON_CEILING,
)
mexecon_plus_two_sheets = ClothedMethod(
    names=("mexecon+two-sheets", "MExECON+, two sheets of 8 views"),
    fit=BodyFit("mexecon+two-sheets-body", "JMBO+, 8 views", _ALL, JMBO_PLUS),
    plan=SheetPlan((_FRONT, _BACK), _near_sides),
    settings=ClothedSettings(
        prior_weight=_PRIOR_WEIGHT, clothes="silhouettes", thickness_m=0.0, faces=0
    ),
)


_FRONT_ECON = 0


def _two_sides(views: Sequence[tuple[ViewMaps, FrontBackDepth]]) -> list[Mesh]:
    """The front and the back sheet on the front view's pixels."""
    ((maps, depth),) = views
    return list(front_back_sheets(depth.front, depth.back, maps.view.camera))


econ = ClothedMethod(
    names=("econ", "ECON"),
    fit=BodyFit("econ-body", "Body, front view", (_FRONT_ECON,), ECON_FIT),
    plan=SheetPlan((_FRONT_ECON,), _two_sides),
    settings=ClothedSettings(hands="detected"),
    published=ECON,
)
