"""Markdown, CSV and JSON say the same as the table they are made of."""

import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import pytest

from harness.run.store import RunStore
from reports.formats.latex import to_markdown
from reports.formats.programs import to_csv, to_json
from reports.tables.cost import cost_table
from reports.tables.geometry import GEOMETRY_METRICS, geometry_table
from reports.tables.selection import Asked

RECORDS = RunStore(Path(__file__).parents[3] / "golden" / "run").records()
HULL = [record for record in RECORDS if record.method_name == "hull8"]


def spread(values):
    return min(values), max(values)


def test_json_has_the_documented_form():
    document = json.loads(to_json(geometry_table(RECORDS, Asked(interval=spread))))
    assert document["table"] == "geometry"
    assert document["protocol"]["name"] == "mexecon"
    rows = {row["method"]: row for row in document["rows"]}
    assert (rows["mexecon"]["n"], rows["mexecon"]["of"]) == (2, 3)
    for row in rows.values():
        assert tuple(row["metrics"]) == GEOMETRY_METRICS
        assert all(set(cell) == {"mean", "low", "high"} for cell in row["metrics"].values())
    chamfer = rows["hull8"]["metrics"]["chamfer"]
    values = [record.metrics["chamfer"].value for record in HULL]
    assert chamfer == {"mean": fmean(values), "low": min(values), "high": max(values)}
    assert rows["vggt"]["metrics"]["chamfer"] == {"mean": None, "low": None, "high": None}


def test_json_tells_what_rows_are_ranked_by():
    document = json.loads(to_json(geometry_table(RECORDS)))
    assert document["ranked_on"] == {key: ["a01", "a03"] for key in GEOMETRY_METRICS}
    rows = {row["method"]: row for row in document["rows"]}
    values = [r.metrics["chamfer"].value for r in HULL if r.subject != "a02"]
    assert rows["hull8"]["ranked_by"]["chamfer"] == fmean(values)
    assert rows["mexecon"]["ranked_by"]["chamfer"] == rows["mexecon"]["metrics"]["chamfer"]["mean"]
    assert (rows["gt"]["ranked_by"], rows["vggt"]["ranked_by"]) == ({}, {})


def test_json_of_costs_names_the_statistic():
    document = json.loads(to_json(cost_table(HULL)))
    row = document["rows"][0]
    assert set(row["metrics"]["wall_s"]) == {"mean", "low", "high"}
    assert set(row["metrics"]["peak_rss_mib"]) == {"max"}
    assert [stage["stage"] for stage in row["stages"]] == ["carve", "contour"]


def test_csv_has_unrounded_numbers_and_says_what_they_are():
    table = geometry_table(RECORDS, Asked(published=True))
    lines = list(csv.DictReader(io.StringIO(to_csv(table))))
    measured = [line for line in lines if line["block"] == "measured"]
    assert [line["method"] for line in measured] == [row.method for row in table.rows]
    for line, row in zip(measured, table.rows, strict=True):
        assert line["dataset"] == "avatars"
        assert line["protocol"].startswith("mexecon-2-")
        cell = row.cells.get("chamfer")
        assert line["chamfer_mean_mm"] == (str(cell.value) if cell else "")
    published = [line for line in lines if line["block"] == "published"]
    assert [line["chamfer_mean_mm"] for line in published] == ["40.56", "32.76", "23.12", "23.87"]
    assert {line["method"] for line in published} == {""}


def test_csv_does_not_put_a_number_under_another_unit():
    lines = list(csv.DictReader(io.StringIO(to_csv(cost_table(HULL, Asked(published=True))))))
    published = [line for line in lines if line["block"] == "published"]
    assert {line["peak_gpu_mib_max_MiB"] for line in published} == {""}
    assert [line["wall_s_mean_s"] for line in published] == ["45.0", "60.0", "150.0", "5.0"]


@pytest.mark.parametrize(
    "start",
    ["=", "+", "-", "@", "\t", "\r", "\n", "  =", "\u00a0 @", "\ufeff=", "\u200b+", "\uff1d"],
)
def test_csv_text_is_no_formula_and_numbers_stay_numbers(start):
    title = f"{start}HYPERLINK(1)"
    table = geometry_table([replace(r, method=replace(r.method, title=title)) for r in HULL])
    below_zero = {"chamfer": replace(table.rows[0].cells["chamfer"], value=-1.5)}
    table = replace(table, rows=(replace(table.rows[0], cells=below_zero),))
    (line,) = csv.DictReader(io.StringIO(to_csv(table), newline=""))
    assert line["title"] == "'" + title.replace("\r", " ")
    assert line["chamfer_mean_mm"] == "-1.5"


@pytest.mark.parametrize(
    "title",
    ["@octocat", "by (@octocat)", "mail@example.org", "http://example.org", "HTTPS://example.org",
     "www.example.org"],
)  # fmt: skip
def test_markdown_calls_nobody_and_links_nowhere(title):
    method = replace(HULL[0].method, title=title)
    text = to_markdown(geometry_table([replace(record, method=method) for record in HULL]))
    assert title.partition("@")[2] in text
    assert not re.search(r"@\w|://|www\.", text, re.IGNORECASE)


@pytest.mark.parametrize("title", ["a|b", "a\nb", "*bold* `code` <b>", "[x](y)"])
def test_markdown_rows_keep_their_columns_whatever_a_method_is_called(title):
    method = replace(HULL[0].method, title=title)
    text = to_markdown(geometry_table([replace(record, method=method) for record in HULL]))
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {6}
    assert "<b>" not in text


def test_markdown_marks_the_best_and_shows_dashes():
    text = to_markdown(geometry_table(RECORDS))
    # Both rows print it, of different subjects; on those that both have one is better.
    assert text.count("18.40") == 2
    assert text.count("**18.40**") == 1
    assert "| 0/3 | – | – | – | – |" in text
