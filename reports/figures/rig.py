"""The rig figure: estimated and true cameras seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from reports.figures.panels import save

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
    """Draw the rigs of some subjects, side by side; returns the file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6 * len(panels), 5.0), layout="constrained")
    grid = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, panel in zip(grid, panels, strict=True):
        _draw(axes, panel)
    lines, labels = grid[0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    save(figure, path)
    return path


def _draw(axes: Any, panel: RigPanel) -> None:
    axes.scatter(panel.points[:, 0], panel.points[:, 2], s=0.3, color="0.8", linewidths=0)
    for cameras, colour, width, label in (
        (panel.known, "0.55", 2.5, "true"),
        (panel.found, "C3", 0.9, "estimated"),
    ):
        for number, camera in enumerate(cameras):
            x, _, z = _wedge(camera).T
            axes.plot(x, z, color=colour, linewidth=width, label=None if number else label)
    for number, camera in enumerate(panel.known):
        axes.annotate(str(number), 1.08 * camera.position[[0, 2]], fontsize=8, ha="center")
    axes.set_aspect("equal")
    axes.invert_yaxis()  # the front, +Z, is below
    axes.set_title(f"{panel.title}, from above (m)", fontsize=9)
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
