"""Surfaces from normal maps: integrated alone, or front and back together; triangulated sheets."""

from methods.surface.front_back import (
    BodyDepth,
    FrontBackDepth,
    FrontBackParameters,
    integrate_front_back,
)
from methods.surface.fusion import SheetParameters, front_back_sheets
from methods.surface.integration import integrate_normals
