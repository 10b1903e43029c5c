"""Figures: methods side by side with their errors, and a mesh over the photos it came from.

Meshes are seen through the capture's own cameras; nothing is drawn on a screen.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.cameras.rigs import camera_yaw_deg
from harness.core.errors import HarnessError
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster
from reports.figures.panels import (
    PanelWindow,
    blended,
    canvas,
    on_white,
    panel_windows,
    photo,
    save,
    show,
)
from reports.figures.shading import ErrorScale, heat, shaded

_PANEL_INCH = 2.8
_OVERLAY_INCH = 4.0
#: Meshes are drawn at least this high, however small the photos are.
_LEAST_HEIGHT = 420
_TITLE_LENGTH = 20
_FILL = 0.4
_OUTLINE = "#00c030"


@dataclass(frozen=True, slots=True, eq=False)
class MethodMesh:
    """One method's mesh of a subject.

    Attributes:
        title: Above its column.
        mesh: World metres.
        errors_mm: (V,) distance of each vertex to the true surface, or None for no error map.
    """

    title: str
    mesh: Mesh
    errors_mm: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SubjectPanels:
    """One subject's row of the grid: its photos, its scan and what the methods made of it."""

    capture: Capture
    truth: Mesh
    methods: tuple[MethodMesh, ...]


def qualitative_grid(
    subjects: Sequence[SubjectPanels],
    path: Path,
    scale: ErrorScale,
) -> None:
    """Write the figure: photo, each method with its errors, scan; one row per subject.

    Photo and scan have two panels, front and back (the view nearest to opposite of the front); a
    method has a third for its errors. All panels have one scale, and all panels of a subject and
    view one camera and one crop.

    Args:
        subjects: One row each; all with the same methods in the same order.
        path: PNG, PDF or SVG, by its extension.
        scale: Colours of the errors, for the whole figure.

    Raises:
        HarnessError: no subjects, or not the same methods for all.
        DataError: a photo that is not usable, or errors that do not fit their mesh.
    """
    titles = [[method.title for method in subject.methods] for subject in subjects]
    if not titles or any(row != titles[0] for row in titles):
        raise HarnessError("a grid needs subjects with the same methods", got=str(titles))
    views = [_front_and_back(subject.capture) for subject in subjects]
    frames = panel_windows(
        [
            (subject.truth, subject.capture.cameras[view])
            for subject, pair in zip(subjects, views, strict=True)
            for view in pair
        ],
        _PANEL_INCH,
    )
    columns = 4 + 3 * len(titles[0])
    figure, axes = canvas((len(subjects), columns), frames[0].window, _PANEL_INCH)
    starts = [0, *range(2, columns - 2, 3), columns - 2]
    for start, title in zip(starts, ["Photo", *titles[0], "Ground truth"], strict=True):
        axes[0][start].set_title(textwrap.fill(title, _TITLE_LENGTH), fontsize=9, loc="left")
    for index, subject in enumerate(subjects):
        pair = frames[2 * index : 2 * index + 2]
        _draw_subject(subject, axes[index], list(zip(views[index], pair, strict=True)), scale)
    colour_bar(figure, axes, scale)
    save(figure, path)


def _front_and_back(capture: Capture) -> tuple[int, int]:
    """The front view, and the one that is nearest to opposite of it."""

    def off_deg(view: int) -> float:
        yaw = camera_yaw_deg(capture.cameras[view]) - capture.front_yaw_deg
        return abs((yaw % 360.0) - 180.0)

    return 0, min(range(len(capture.cameras)), key=off_deg)


def _draw_subject(
    subject: SubjectPanels, row: Any, frames: Sequence[tuple[int, PanelWindow]], scale: ErrorScale
) -> None:
    cameras = [
        frame.of_camera(subject.capture.cameras[view], _LEAST_HEIGHT) for view, frame in frames
    ]
    row[0].set_ylabel(subject.capture.subject, fontsize=9)
    panels = [frame.of_image(photo(subject.capture, view)) for view, frame in frames]
    for method in subject.methods:
        caster = Raycaster(method.mesh)
        panels += [on_white(shaded(caster, camera)) for camera in cameras]
        if method.errors_mm is None:
            panels.append(np.ones_like(panels[-1]))
        else:
            panels.append(on_white(heat(caster, cameras[0], method.errors_mm, scale)))
    caster = Raycaster(subject.truth)
    panels += [on_white(shaded(caster, camera)) for camera in cameras]
    for axis, panel in zip(row, panels, strict=True):
        show(axis, panel)


def colour_bar(figure: Any, axes: Any, scale: ErrorScale) -> None:
    """Put the colours of the errors beside a figure's axes (rows, columns)."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    colours = ScalarMappable(Normalize(0.0, scale.limit), scale.colours)
    # At most as long as two rows, however many subjects there are.
    share = min(0.6, 2.0 / len(axes))
    bar = figure.colorbar(colours, ax=axes, shrink=share, aspect=25, extend="max")
    bar.set_label(scale.label, fontsize=9)


def overlay_figure(mesh: Mesh, capture: Capture, path: Path, columns: int = 4) -> None:
    """Write the mesh over every photo of a capture, seen by the photo's own camera.

    The line is the outline of the mesh at half coverage. Where camera, mesh and photo agree it runs
    along the subject's edge.

    Args:
        mesh: World metres; a scan, or a reconstruction.
        capture: Photos and cameras.
        path: PNG, PDF or SVG, by its extension.
        columns: Views beside each other.

    Raises:
        DataError: a photo that is not usable, or the file cannot be written.
    """
    count = len(capture.cameras)
    columns = min(columns, count)
    frames = panel_windows([(mesh, camera) for camera in capture.cameras], _OVERLAY_INCH)
    figure, axes = canvas((-(-count // columns), columns), frames[0].window, _OVERLAY_INCH)
    caster = Raycaster(mesh)
    for view, (axis, frame) in enumerate(zip(axes.flat, frames, strict=False)):
        clay = shaded(caster, frame.of_camera(capture.cameras[view]))
        show(axis, blended(frame.of_image(photo(capture, view)), clay, _FILL))
        if clay[..., 3].min() < 0.5 < clay[..., 3].max():
            axis.contour(clay[..., 3], levels=[0.5], colors=_OUTLINE, linewidths=0.7)
        axis.set_title(f"{capture.subject}, view {view}", fontsize=9)
    save(figure, path)
