"""The normals figure: photo, body, estimate, truth and error, of the front and of the back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, NormalMaps
from harness.core.errors import HarnessError
from harness.geometry.images import normal_colours
from harness.geometry.raycast import Side
from harness.geometry.window import Window
from reports.figures.comparison import colour_bar
from reports.figures.panels import canvas, photo, save, show
from reports.figures.shading import ErrorScale

_PANEL_INCH = 2.4
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
    figure, axes = canvas((len(rows), len(titles)), window, _PANEL_INCH)
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
