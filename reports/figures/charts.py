"""The views figure: error over the number of photos, a line for each method."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.errors import HarnessError
from harness.core.metric_catalog import METRICS
from reports.figures.panels import save
from reports.tables.table import Table
from reports.tables.views import ViewSeries

_SHOWN = ("chamfer", "normal_error")
_LEAST_POINTS = 2


def view_curves(series: Sequence[ViewSeries], path: Path, caption: str) -> Path:
    """Draw Chamfer and normal error over the number of views; returns the file.

    Args:
        series: Methods, each with several numbers of views.
        path: Of the picture; its name's end decides the format.
        caption: Stands below: dataset, recipe, number of subjects.

    Raises:
        HarnessError: no method has several numbers of views.
    """
    from matplotlib.figure import Figure

    if not series:
        raise HarnessError(
            "no method was run with several numbers of views",
            hint="Run: harness eval --recipe ring32 --method mexecon+ --set nview.views=4 --as "
            "mexecon+-4, and the same with 8",
        )
    figure = Figure(figsize=(8.4, 3.6), layout="constrained")
    for axes, metric in zip(figure.subplots(1, len(_SHOWN)), _SHOWN, strict=True):
        _draw(axes, series, metric)
    figure.supxlabel(caption, fontsize=8, color="0.4")
    save(figure, path)
    return path


def _draw(axes: Any, series: Sequence[ViewSeries], metric: str) -> None:
    described = METRICS[metric]
    ticks = sorted({point.views for each in series for point in each.points})
    for each in series:
        views = [point.views for point in each.points]
        cells = [point.means[metric] for point in each.points]
        (line,) = axes.plot(views, [cell.value for cell in cells], "o-", label=each.title)
        if all(cell.low is not None for cell in cells):
            low, high = ([getattr(cell, end) for cell in cells] for end in ("low", "high"))
            axes.fill_between(views, low, high, color=line.get_color(), alpha=0.15, linewidth=0)
    axes.set_xscale("log", base=2)
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(bottom=0)
    axes.set_xlabel("views")
    axes.set_title(f"{described.title} ({described.unit})", fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="0.9")
    axes.legend(frameon=False, fontsize=8)


_RANK = "_rank"


def rank_curves(table: Table, path: Path, caption: str) -> Path:
    """Draw the ranks of a protocols' table with their intervals; returns the file.

    Args:
        table: As ``protocols_table`` makes it.
        path: Of the picture; its name's end decides the format.
        caption: Stands below: dataset, recipe, number of subjects.
    """
    from matplotlib.figure import Figure

    ids = [column.id for column in table.columns if column.id.endswith(_RANK)]
    figure = Figure(
        figsize=(1.6 + 0.9 * len(ids), 0.8 + 0.5 * len(table.rows)), layout="constrained"
    )
    axes = figure.subplots()
    for shift, row in enumerate(table.rows):
        found = [(place, row.cells[each]) for place, each in enumerate(ids) if each in row.cells]
        places = [place + 0.04 * (shift - len(table.rows) / 2) for place, _ in found]
        ranks = [cell.value for _, cell in found]
        ends = [
            [max(0.0, cell.value - (cell.low or cell.value)) for _, cell in found],
            [max(0.0, (cell.high or cell.value) - cell.value) for _, cell in found],
        ]
        axes.errorbar(places, ranks, yerr=ends, fmt="o-", capsize=2, label=row.title)
    axes.set_xticks(range(len(ids)), [each.removesuffix(_RANK) for each in ids], rotation=30)
    axes.set_yticks(range(1, len(table.rows) + 1))
    axes.invert_yaxis()
    axes.set_ylabel("rank")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.supxlabel(caption, fontsize=8, color="0.4")
    save(figure, path)
    return path


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
        _draw_rig(axes, panel)
    lines, labels = grid[0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    save(figure, path)
    return path


def _draw_rig(axes: Any, panel: RigPanel) -> None:
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
