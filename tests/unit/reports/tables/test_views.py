"""Error by number of views: rows in order, and the curves that are drawn of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.core.errors import HarnessError
from harness.run.store import RunStore
from reports.figures.charts import view_curves
from reports.formats.latex import to_markdown
from reports.statistics import bootstrap_ends
from reports.tables.selection import Asked
from reports.tables.views import view_series, views_table

HULL = [
    record
    for record in RunStore(Path(__file__).parents[3] / "golden" / "run").records()
    if record.method_name == "hull8" and record.status == "ok"
]


def row(name, title, count, factor=1.0, views=32):
    """The records of a row that used so many of the views, with errors times a factor."""

    def scaled(record):
        metrics = {
            key: replace(value, value=factor * value.value) for key, value in record.metrics.items()
        }
        method = replace(record.method, name=name, title=title, views=None, view_count=count)
        stamp = replace(record.capture, views=views)
        return replace(record, method=method, metrics=metrics, capture=stamp)

    return [scaled(record) for record in HULL]


RECORDS = [
    *row("hull-16", "Hull, all views, views=16", 16, 0.5),
    *row("other", "Other", None, 3.0),
    *row("hull-4", "Hull, all views, views=4", 4, 1.0),
    *row("hull", "Hull, all views", None, 0.25),
]


def test_rows_of_a_method_stand_together_by_number_of_views():
    table = views_table(RECORDS)
    assert [row.method for row in table.rows] == ["hull-4", "hull-16", "hull", "other"]
    assert [row.cells["views"].value for row in table.rows] == [4, 16, 32, 32]
    assert table.columns[0].id == "views"
    assert "| Method | Views | Chamfer (mm)" in to_markdown(table)
    first, last = table.rows[0].cells["chamfer"].value, table.rows[2].cells["chamfer"].value
    assert last == pytest.approx(first / 4)


def test_a_row_whose_views_are_not_known_is_named():
    table = views_table([*RECORDS[:3], *row("old", "Old", None, views=0)])
    assert "old" not in [row.method for row in table.rows]
    assert "not known: Old" in " ".join(table.remarks)


def test_series_need_two_numbers_of_views():
    (series,) = view_series(views_table(RECORDS))
    assert series.title == "Hull"
    assert [point.views for point in series.points] == [4, 16, 32]


def test_curves_are_drawn_with_their_bands(tmp_path):
    table = views_table(RECORDS, Asked(interval=bootstrap_ends))
    paths = [tmp_path / name for name in ("views.png", "again.png")]
    for path in paths:
        view_curves(view_series(table), path, "toy, 3 subjects")
    assert paths[0].read_bytes() == paths[1].read_bytes()
    picture = np.asarray(Image.open(paths[0]).convert("RGB"))
    # The line and its band are blue on white.
    assert (picture[..., 2].astype(int) - picture[..., 0] > 80).sum() > 300


def test_without_series_the_next_command_is_named(tmp_path):
    with pytest.raises(HarnessError, match=r"several numbers of views.*nview\.views=4"):
        view_curves((), tmp_path / "views.png", "")


def test_a_row_that_is_not_shown_does_not_decide_what_the_others_are_ranked_by():
    lone = row("old", "Old", None, views=0)[:1]
    table = views_table([*RECORDS, *lone])
    assert table.rows == views_table(RECORDS).rows
    assert not [row for row in table.rows if "all ranked rows" in " ".join(row.notes)]
