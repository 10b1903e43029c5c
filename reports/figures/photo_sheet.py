"""A sheet for the eye: photos, and what a method made of them, from where the photos were taken."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.arrays import Bytes, Floats, Mask
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.images import normal_colours, resampled
from harness.geometry.photo import WHITE, Photo
from harness.geometry.raycast import Raycaster
from harness.geometry.window import Window
from reports.figures.panels import PanelWindow, canvas, on_white, save, shaded, show

#: More photos are not shown: a sheet is to be seen at once.
_MOST_SHOWN = 8
#: Where few photos show a person, the mesh is also shown turned by so many degrees.
_FEW, _TURNS_DEG = 2, (45.0, 90.0, 180.0, 270.0)
_PANEL_INCH = 2.6
_MARGIN = 0.08
#: Outlines: the mesh's in red, the mask's in blue, both where they meet in dark.
_MESH_LINE, _MASK_LINE = (0.9, 0.1, 0.1), (0.1, 0.3, 0.9)


@dataclass(frozen=True, slots=True, eq=False)
class SheetInput:
    """What is drawn.

    Attributes:
        title: Above the sheet.
        photos: Of the person.
        mesh: What a method made of them, world metres.
        colours: (V, 3) uint8 of its vertices; None leaves the coloured row out.
        figures: One line for each photo, such as its silhouette's IoU.
    """

    title: str
    photos: Sequence[Photo]
    mesh: Mesh
    colours: Bytes | None
    figures: Sequence[str]


def draw_photo_sheet(given: SheetInput, path: Path) -> None:
    """Draw photo, outlines, normals and shaded mesh of up to eight photos, one column each.

    Raises:
        DataError: the file cannot be written.
    """
    caster = Raycaster(given.mesh.geometry())
    count = len(given.photos)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST_SHOWN)).round().astype(int))
    columns = [_photo_column(given, caster, int(index)) for index in chosen]
    if count <= _FEW:
        columns += [_turned_column(given, caster, angle) for angle in _TURNS_DEG]
    rows = [
        "photo",
        "outlines",
        "normals",
        "mesh",
        *(["colours"] if given.colours is not None else []),
    ]
    shape = (len(rows), len(columns))
    widest = max((column.window for column in columns), key=lambda w: w.width / w.height)
    figure, axes = canvas(shape, widest, _PANEL_INCH)
    figure.suptitle(given.title, fontsize=9)
    for index, column in enumerate(columns):
        axes[0, index].set_title(column.label, fontsize=6)
        for row, panel in enumerate(column.panels):
            if panel is not None:
                show(axes[row, index], panel)
    for row, name in enumerate(rows):
        axes[row, 0].set_ylabel(name, fontsize=8)
    save(figure, path)


@dataclass(frozen=True, slots=True, eq=False)
class _Column:
    label: str
    window: Window
    panels: list[Floats | None]


def _photo_column(given: SheetInput, caster: Raycaster, index: int) -> _Column:
    photo = given.photos[index]
    panel = _panel(given.mesh, photo.camera, photo.mask)
    camera = panel.of_camera(photo.camera)
    cut = panel.of_image(photo.over(WHITE))
    mask = resampled(panel.window.cut(photo.coverage), panel.shown, "box")
    panels: list[Floats | None] = [cut, _outlined(cut, mask > 0.5, caster.mask(camera))]
    return _Column(
        f"{index}: {given.figures[index]}",
        panel.window,
        panels + _mesh_panels(given, caster, camera),
    )


def _turned_column(given: SheetInput, caster: Raycaster, angle_deg: float) -> _Column:
    """The mesh alone, seen from the first photo's place gone round the person."""
    first = given.photos[0]
    centre = given.mesh.bounds.mean(axis=0)
    angle = np.radians(-angle_deg)
    turn = np.eye(4)
    turn[0, 0] = turn[2, 2] = np.cos(angle)
    turn[0, 2], turn[2, 0] = np.sin(angle), -np.sin(angle)
    turn[:3, 3] = centre - turn[:3, :3] @ centre
    whole = first.camera.in_frame(turn)
    panel = _panel(given.mesh, whole, None)
    camera = panel.of_camera(whole)
    panels: list[Floats | None] = [None, None]
    return _Column(
        f"{angle_deg:.0f} degrees round", panel.window, panels + _mesh_panels(given, caster, camera)
    )


def _mesh_panels(given: SheetInput, caster: Raycaster, camera: Camera) -> list[Floats | None]:
    panels: list[Floats | None] = [
        normal_colours(caster.normals(camera)),
        on_white(shaded(caster, camera)),
    ]
    if given.colours is not None:
        hits = caster.cast(camera)
        colours = hits.interpolate(given.colours / 255.0, caster.mesh.faces)
        panels.append(np.where(hits.mask[..., None], colours, 1.0))
    return panels


def _panel(mesh: Mesh, camera: Camera, mask: Mask | None) -> PanelWindow:
    """A window round mesh and mask."""
    box = Window.around_points(mesh.vertices, camera)
    if mask is not None and mask.any():
        other = Window.around(mask)
        left, top = min(box.left, other.left), min(box.top, other.top)
        right, bottom = max(box.right, other.right), max(box.bottom, other.bottom)
        box = other if box.is_empty else Window(left, top, right - left, bottom - top)
    grown = box.grown(round(_MARGIN * max(1, box.longer_side)) + 1)
    return PanelWindow(grown, round(150 * _PANEL_INCH))


def _outlined(picture: Floats, mask: Mask, ours: Mask) -> Floats:
    """A picture (H, W, 3), paler, with the outlines of two masks."""
    drawn = 0.5 + 0.5 * picture
    drawn[_edge(mask)] = _MASK_LINE
    drawn[_edge(ours)] = _MESH_LINE
    drawn[_edge(mask) & _edge(ours)] = (0.2, 0.05, 0.2)
    return drawn


def _edge(mask: Mask) -> Mask:
    from scipy.ndimage import binary_erosion

    return mask & ~np.asarray(binary_erosion(mask, border_value=1), dtype=bool)
