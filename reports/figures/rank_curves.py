"""The ranks figure: each method's place under each protocol, a line for each method."""

from __future__ import annotations

from pathlib import Path

from reports.figures.panels import save
from reports.tables.table import Table

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
