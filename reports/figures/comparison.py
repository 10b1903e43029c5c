"""Figures: methods side by side with their errors, and a mesh over the photos it came from.

Meshes are seen through the capture's own cameras; nothing is drawn on a screen.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, NormalMaps
from harness.core.errors import HarnessError
from harness.core.mesh import Mesh
from harness.core.rigs import camera_yaw_deg
from harness.geometry.images import normal_colours
from harness.geometry.raycast import Raycaster, Side
from harness.geometry.window import Window
from reports.figures.panels import (
    ErrorScale,
    PanelWindow,
    blended,
    canvas,
    heat,
    on_white,
    panel_windows,
    photo,
    save,
    shaded,
    show,
)

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


_PANEL_INCH_NORMAL_GRID = 2.4
_MARGIN = 0.02
#: A panel is so much higher than its picture, so that titles and numbers have their place.
_ROOM = 1.12
_SCALE = ErrorScale(60.0, "angle to the true normal (°)")
_TITLES = ("Body", "Estimate", "Truth", "Error")


@dataclass(frozen=True, slots=True, eq=False)
class NormalPanels:
    """One side of the subject in one photo.

    Attributes:
        title: Above the photo; empty for a side that the photo before it hides, which then is not
            shown again.
        maps: The estimate, and the body's normals.
        side: Which of them are shown.
        true: (H, W, 3) normals of the scan on the same pixels, 0 beside it.
        errors_deg: (H, W) of the estimate; NaN where it is not compared.
        body_text: Shown below the body's normals.
        estimate_text: Shown below the errors of the estimate.
    """

    title: str
    maps: NormalMaps
    side: Side
    true: Floats
    errors_deg: Floats
    body_text: str
    estimate_text: str


@dataclass(frozen=True, slots=True, eq=False)
class NormalRow:
    """One subject: its photos, and the sides that are shown."""

    capture: Capture
    sides: tuple[NormalPanels, ...]


def normal_grid(rows: Sequence[NormalRow], path: Path) -> None:
    """Write the figure: one row per subject; errors from 60 degrees on have the last colour.

    Args:
        rows: All with the same sides in the same order.
        path: PNG, PDF or SVG, by its extension.

    Raises:
        HarnessError: no rows, or not the same sides for all.
        DataError: a photo that is not usable.
    """
    sides = [[(panels.title, panels.side) for panels in row.sides] for row in rows]
    if not sides or any(each != sides[0] for each in sides):
        raise HarnessError("a grid needs subjects with the same photos and sides", got=str(sides))
    titles = [title for panels in rows[0].sides for title in _titles(panels)]
    share = _shown_share([panels.maps.mask for row in rows for panels in row.sides])
    window = Window(0, 0, round(1000 * share[0]), round(_ROOM * 1000 * share[1]))
    figure, axes = canvas((len(rows), len(titles)), window, _PANEL_INCH_NORMAL_GRID)
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=9)
    for row, line in zip(rows, axes, strict=True):
        line[0].set_ylabel(row.capture.subject, fontsize=10)
        remaining = iter(line)
        for panels in row.sides:
            _draw(row.capture, panels, share, remaining)
    colour_bar(figure, axes, _SCALE)
    save(figure, path)


def _titles(panels: NormalPanels) -> list[str]:
    first, *others = _TITLES
    if panels.title:
        return [panels.title, first, *others]
    return [f"{first}, far side", *others]


def _draw(capture: Capture, panels: NormalPanels, share: tuple[float, float], axes: Any) -> None:
    maps, near = panels.maps, panels.side == "near"
    pictures = [
        normal_colours(maps.body_front if near else maps.body_back),
        normal_colours(maps.front if near else maps.back),
        normal_colours(panels.true),
        _errors(panels.errors_deg),
    ]
    if panels.title:
        window = Window.of_crop(capture.cameras[maps.view], maps.camera)
        pictures.insert(0, window.cut(photo(capture, maps.view), 1.0))
    used = [next(axes) for _ in pictures]
    for axis, picture in zip(used, pictures, strict=True):
        show(axis, _centre(picture, share))
    texts = (panels.body_text, panels.estimate_text)
    for axis, text in zip((used[-4], used[-1]), texts, strict=True):
        axis.set_xlabel(text, fontsize=8)


def _errors(errors_deg: Floats) -> Floats:
    """(H, W, 3) colours of the errors, white where there are none."""
    known = np.isfinite(errors_deg)
    return np.where(known[..., None], _SCALE.rgb(np.where(known, errors_deg, 0.0)), 1.0)


def _shown_share(masks: Sequence[NDArray[np.bool_]]) -> tuple[float, float]:
    """Share of a square's width and height, round its centre, that shows every subject."""
    shares = []
    for axis in (0, 1):
        reach = []
        for mask in masks:
            places = np.flatnonzero(mask.any(axis=axis))
            half = mask.shape[1 - axis] / 2
            reach.append(max(half - places[0], places[-1] + 1 - half) / half)
        shares.append(min(1.0, max(reach) + _MARGIN))
    return shares[0], shares[1]


def _centre(picture: Floats, share: tuple[float, float]) -> Floats:
    """The middle of a picture (H, W, 3)."""
    height, width = picture.shape[:2]
    column, row = (
        round((1 - part) / 2 * side) for part, side in zip(share, (width, height), strict=True)
    )
    return picture[row : height - row, column : width - column]


_BODY_INCH = 3.0
_MOST_VIEWS = 8
_BODY_RGB = (0.25, 0.55, 1.0)
_FILL_BODY_OVERLAY = 0.55


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
    frames = panel_windows([(truth or bodies[0].mesh, camera) for camera in cameras], _BODY_INCH)
    figure, axes = canvas((len(bodies), len(cameras)), frames[0].window, _BODY_INCH)
    seen = [frame.of_camera(camera) for frame, camera in zip(frames, cameras, strict=True)]
    images = [frame.of_image(photo(capture, view)) for view, frame in enumerate(frames)]
    true = Raycaster(truth) if truth else None
    covers = [true.coverage(camera) for camera in seen] if true else [None] * len(seen)
    for row, body in zip(axes, bodies, strict=True):
        caster = Raycaster(body.mesh)
        row[0].set_ylabel(body.title, fontsize=8)
        for axis, camera, image, cover in zip(row, seen, images, covers, strict=True):
            show(axis, blended(image, shaded(caster, camera), _FILL_BODY_OVERLAY, _BODY_RGB))
            if cover is not None:
                axis.contour(cover, levels=[0.5], colors="#00c030", linewidths=0.6)
    save(figure, path)
