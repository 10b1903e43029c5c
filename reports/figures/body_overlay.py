"""Fitted bodies over the photos, one row a method: what the fit gained, and what its head does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from harness.core.artifacts import Capture
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster
from reports.figures.comparison import MethodMesh
from reports.figures.panels import blended, canvas, panel_windows, photo, save, show
from reports.figures.shading import shaded

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
    frames = panel_windows([(truth or bodies[0].mesh, camera) for camera in cameras], _PANEL_INCH)
    figure, axes = canvas((len(bodies), len(cameras)), frames[0].window, _PANEL_INCH)
    seen = [frame.of_camera(camera) for frame, camera in zip(frames, cameras, strict=True)]
    images = [frame.of_image(photo(capture, view)) for view, frame in enumerate(frames)]
    true = Raycaster(truth) if truth else None
    covers = [true.coverage(camera) for camera in seen] if true else [None] * len(seen)
    for row, body in zip(axes, bodies, strict=True):
        caster = Raycaster(body.mesh)
        row[0].set_ylabel(body.title, fontsize=8)
        for axis, camera, image, cover in zip(row, seen, images, covers, strict=True):
            show(axis, blended(image, shaded(caster, camera), _FILL, _BODY_RGB))
            if cover is not None:
                axis.contour(cover, levels=[0.5], colors="#00c030", linewidths=0.6)
    save(figure, path)
