"""The views figure: error over the number of photos, a line for each method."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

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
