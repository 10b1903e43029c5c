"""Fitted bodies over the photos, one row a method: what the fit gained, and what its head does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.artifacts import Capture
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster
from reports.figures import MethodMesh
from reports.panels import canvas, photo, save, show, windows
from reports.shading import shaded

__all__ = ["body_overlay"]

Floats = NDArray[np.float64]

_PANEL_INCH = 3.0
_MOST_VIEWS = 8
_BODY_RGB = (0.25, 0.55, 1.0)
_FILL = 0.55


def body_overlay(
    bodies: Sequence[MethodMesh], truth: Mesh | None, capture: Capture, path: Path
) -> None:
    """Write bodies over every photo of a capture, one row each; the true body's outline in green.

    Args:
        bodies: Titles and surfaces, world metres; at least one.
        truth: The true body, where it is known.
        capture: Photos and cameras.
        path: PNG, PDF or SVG, by its extension.

    Raises:
        DataError: a photo that is not usable, or the file cannot be written.
    """
    cameras = capture.cameras[:_MOST_VIEWS]
    frames = windows([(truth or bodies[0].mesh, camera) for camera in cameras], _PANEL_INCH)
    figure, axes = canvas((len(bodies), len(cameras)), frames[0], _PANEL_INCH)
    outlines = Raycaster(truth) if truth else None
    for row, body in zip(axes, bodies, strict=True):
        caster = Raycaster(body.mesh)
        row[0].set_ylabel(body.title, fontsize=8)
        for view, (axis, frame) in enumerate(zip(row, frames, strict=True)):
            camera = frame.of_camera(cameras[view])
            image = frame.of_image(photo(capture, view))
            show(axis, _tinted(image, shaded(caster, camera)))
            if outlines:
                cover = outlines.coverage(camera)
                axis.contour(cover, levels=[0.5], colors="#00c030", linewidths=0.6)
    save(figure, path)


def _tinted(image: Floats, clay: Floats) -> Floats:
    """An image (H, W, 3) with a shaded body (H, W, 4) over it, in the body's colour."""
    fill = _FILL * clay[..., 3:]
    return image * (1.0 - fill) + clay[..., :3] * _BODY_RGB * fill
