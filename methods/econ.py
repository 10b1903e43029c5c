"""``econ``: one photo to a clothed mesh, both sides from the front view.

Xiu, Yang, Cao, Tzionas, Black, "ECON: Explicit Clothed humans Optimized via Normal integration",
CVPR 2023, with the body-based completion (ECON_EX). ``harness methods show econ`` lists every
difference from it.
"""

from __future__ import annotations

from collections.abc import Sequence

from harness.core.mesh import Mesh
from methods.body_fit import BodyFit
from methods.clothed import ClothedMethod, ClothedSettings, SheetPlan
from methods.fit_settings import ECON_FIT
from methods.normals import ViewMaps
from methods.publications.completion import ECON
from methods.surface import FrontBackDepth, front_back_sheets

_FRONT = 0


def _two_sides(views: Sequence[tuple[ViewMaps, FrontBackDepth]]) -> list[Mesh]:
    """The front and the back sheet on the front view's pixels."""
    ((maps, depth),) = views
    return list(front_back_sheets(depth.front, depth.back, maps.view.camera))


econ = ClothedMethod(
    names=("econ", "ECON"),
    fit=BodyFit("econ-body", "Body, front view", (_FRONT,), ECON_FIT),
    plan=SheetPlan((_FRONT,), _two_sides),
    settings=ClothedSettings(hands="detected"),
    published=ECON,
)
