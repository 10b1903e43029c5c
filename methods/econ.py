"""``econ``: one photo to a clothed mesh, both sides from the front view.

Xiu, Yang, Cao, Tzionas, Black, "ECON: Explicit Clothed humans Optimized via Normal integration",
CVPR 2023, with the body-based completion (ECON_EX). Deviations: the camera is the known, full
perspective one instead of an orthographic crop; the body is fitted as everywhere here; the body is
completed by offsets along its normals (``methods/surface/completion.py``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from harness.core.mesh import Mesh
from methods.body_fit import DEFAULT, BodyFit
from methods.normals import ViewMaps
from methods.surface import FrontBackDepth, front_back_sheets
from methods.surface.clothed import ClothedMethod, ClothedSettings, SheetPlan

__all__ = ["econ"]

_FRONT = 0


def _two_sides(views: Sequence[tuple[ViewMaps, FrontBackDepth]]) -> list[Mesh]:
    """The front and the back sheet on the front view's pixels."""
    ((maps, depth),) = views
    return list(front_back_sheets(depth.front, depth.back, maps.view.camera))


econ = ClothedMethod(
    names=("econ", "ECON"),
    fit=BodyFit("econ-body", "Body, front view", (_FRONT,), replace(DEFAULT, stage="jmbo")),
    plan=SheetPlan((_FRONT,), _two_sides),
    settings=ClothedSettings(hands="body"),
)
