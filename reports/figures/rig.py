"""The rig figure: estimated and true cameras seen from above, and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from reports.figures.panels import save

#: World axes to the right and upwards in the two pictures, and their names.
_SIDES = (((0, 2), "from above"), ((0, 1), "from the front"))
_TRUE, _FOUND = "0.55", "C3"
#: Pictures are drawn at this share of a camera's distance.
_SHARE = 0.12


@dataclass(frozen=True, slots=True, eq=False)
class RigPanel:
    """One subject's cameras.

    Attributes:
        title: Stands above.
        found: Estimated, brought to the true world.
        known: The true ones.
        points: (N, 3) of the subject.
    """

    title: str
    found: Sequence[Camera]
    known: Sequence[Camera]
    points: Floats


def rig_figure(panels: Sequence[RigPanel], path: Path) -> Path:
    """Draw the rigs of some subjects, a row each; returns the file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.4 * len(panels)), layout="constrained")
    grid = figure.subplots(len(panels), len(_SIDES), squeeze=False)
    for row, panel in zip(grid, panels, strict=True):
        for axes, (plane, words) in zip(row, _SIDES, strict=True):
            _draw(axes, panel, plane)
            axes.set_title(f"{panel.title}, {words}", fontsize=9)
    lines, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    save(figure, path)
    return path


def _draw(axes: Any, panel: RigPanel, plane: tuple[int, int]) -> None:
    right, up = plane
    axes.scatter(panel.points[:, right], panel.points[:, up], s=0.3, color="0.8", linewidths=0)
    for cameras, colour, width, label in (
        (panel.known, _TRUE, 2.5, "true"),
        (panel.found, _FOUND, 0.9, "estimated"),
    ):
        for number, camera in enumerate(cameras):
            x, y = _wedge(camera)[:, [right, up]].T
            axes.plot(x, y, color=colour, linewidth=width, label=label if not number else None)
    for number, camera in enumerate(panel.known):
        axes.annotate(str(number), 1.08 * camera.position[[right, up]], fontsize=8, ha="center")
    axes.set_aspect("equal")
    if up == 2:
        axes.invert_yaxis()  # the front, +Z, is below
    axes.set_xlabel("m", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)


def _wedge(camera: Camera) -> Floats:
    """(12, 3) corners of a camera's pyramid, along its edges."""
    width, height = camera.size
    depth = _SHARE * float(np.linalg.norm(camera.position))
    pixels = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=float)
    a, b, c, d = camera.unproject(pixels, np.full(4, depth))
    p, q, r, s = camera.ray_origins(pixels)
    return np.stack([p, a, b, q, b, c, r, c, d, s, d, a])
