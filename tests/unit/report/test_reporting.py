"""A run's records become a table by name, in the format asked for."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from harness.core.errors import HarnessError
from harness.core.metric_catalog import METRICS
from harness.core.records import (
    AngularErrors,
    AngularPair,
    MetricValue,
    NormalMapErrors,
    RegionErrors,
)
from harness.report.tables import (
    FORMATS,
    TABLES,
    ReportRequest,
    build_table,
    in_order,
    write_tables,
)
from harness.run.store import RunStore
from reports.tables.geometry import CAMERA_METRICS

RECORDS = RunStore(Path(__file__).parents[2] / "golden" / "run").records()
HEAD = RegionErrors(
    area_share=0.2,
    accuracy_mm=3.0,
    completeness_mm=4.0,
    normal_error_deg=9.0,
    missing_share=0.0,
    bulge_share=0.0,
    n_predicted=10,
    n_truth=10,
)
PIXELS = AngularErrors(9.0, 7.0, 0.9, 0.9, 0.9, n=10)
MAPS = (NormalMapErrors(0, 0.0, "near", None, AngularPair(PIXELS, PIXELS), None),)
CAMERAS = {name: MetricValue(0.5, METRICS[name].unit, 28, 0.0) for name in CAMERA_METRICS}
LABELLED = [
    replace(r, regions={"head": HEAD}, normal_maps=MAPS, metrics={**r.metrics, **CAMERAS})
    for r in RECORDS
]
OURS = [record for record in RECORDS if record.method_name in ("hull8", "gt")]


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("form", FORMATS)
def test_every_table_has_every_format(table, form):
    text = build_table(LABELLED, ReportRequest(table=table, format=form))
    # The body table has no row for methods that fit no body.
    assert ("VGGT" if table == "jmbo" else "Visual hull") in text
    assert text.endswith("\n")


def test_rows_stand_in_the_order_of_the_catalogue_and_unknown_methods_last():
    document = json.loads(build_table(RECORDS, ReportRequest(format="json")))
    names = [row["method"] for row in document["rows"]]
    assert set(names) == {record.method_name for record in RECORDS}
    assert names.index("hull8") < names.index("gt")
    asked = ReportRequest(format="json", methods=("gt", "hull8"))
    rows = json.loads(build_table(RECORDS, asked))["rows"]
    assert [row["method"] for row in rows] == ["gt", "hull8"]


def test_cameras_have_a_deviation_where_a_search_told_one():
    asked = ReportRequest(table="cameras", format="json")
    silent = [
        replace(r, metrics={n: v for n, v in r.metrics.items() if not n.endswith("rotation_sd")})
        for r in LABELLED
    ]
    mixed = [a if a.method_name == "hull8" else b for a, b in zip(LABELLED, silent, strict=True)]
    rows = {row["method"]: row["metrics"] for row in json.loads(build_table(mixed, asked))["rows"]}
    assert rows["hull8"]["camera_rotation_sd"]["mean"] == 0.5
    assert rows["gt"]["camera_rotation_sd"] != rows["hull8"]["camera_rotation_sd"]
    for row in json.loads(build_table(silent, asked))["rows"]:
        assert set(row["metrics"]) == set(CAMERAS) - {"camera_rotation_sd"}


def test_an_interval_on_request_holds_the_mean():
    document = json.loads(build_table(OURS, ReportRequest(format="json", interval=True)))
    chamfer = document["rows"][0]["metrics"]["chamfer"]
    values = [r.metrics["chamfer"].value for r in OURS if r.method_name == "hull8"]
    assert min(values) - 1e-9 <= chamfer["low"] < chamfer["mean"]
    assert chamfer["mean"] < chamfer["high"] <= max(values) + 1e-9
    again = json.loads(build_table(OURS, ReportRequest(format="json", interval=True)))
    assert again == document


def test_the_published_block_is_there_on_request():
    assert "40.56" in build_table(OURS, ReportRequest(published=True))
    assert "40.56" not in build_table(OURS, ReportRequest())


@pytest.mark.parametrize(
    ("request_", "match"),
    [
        (ReportRequest(table="geometri"), "unknown table 'geometri'.*Did you mean 'geometry'"),
        (ReportRequest(format="latx"), "unknown format 'latx'.*Did you mean 'latex'"),
    ],
)
def test_an_unknown_name_is_refused_with_the_nearest_one(request_, match):
    with pytest.raises(HarnessError, match=match):
        build_table(RECORDS, request_)


@pytest.mark.parametrize(
    ("table", "match"),
    [
        ("regions", "the table 'regions'.*Visual hull"),
        ("jmbo", "the table 'jmbo'.*Visual hull"),
        ("normals", "the table 'normals'.*Visual hull"),
    ],
)
def test_a_table_that_nobody_has_numbers_for_is_refused_when_asked_for(table, match):
    with pytest.raises(HarnessError, match=match):
        build_table(OURS, ReportRequest(table=table))


def test_all_tables_are_written(tmp_path):
    files = write_tables(RECORDS, tmp_path)
    assert {path.name for path in files} == {
        f"{table}.{extension}" for table in TABLES for _, extension in FORMATS.values()
    }
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in files)
    stored = (tmp_path / "geometry.tex").read_text(encoding="utf-8")
    assert stored == build_table(RECORDS, ReportRequest(format="latex"))
    assert "Without errors by region" in (tmp_path / "regions.md").read_text(encoding="utf-8")


def test_figures_take_the_methods_asked_for_in_their_order():
    chosen = in_order(RECORDS, ("gt", "hull8"))
    assert list(dict.fromkeys(record.method_name for record in chosen)) == ["gt", "hull8"]
    assert len(in_order(RECORDS, ())) == len(RECORDS)
    with pytest.raises(HarnessError, match="hull8"):
        in_order(RECORDS, ("hull9",))
