"""The published numbers: complete, apart, never compared with ours, and with their unit."""

import csv
import io
import json
from pathlib import Path

import pytest

from harness.core.errors import HarnessError
from harness.data.manifest import load_manifest
from harness.report.tables import FORMATS, ReportRequest, build_published, build_table
from harness.run.store import RunStore
from reports.formats.latex import to_latex
from reports.published import PUBLISHED, UNIT_NOTE
from reports.published.printed import STORED_METHODS, SUBJECTS, stored_averages, stored_records
from reports.tables.cost import cost_table
from reports.tables.geometry import GEOMETRY_METRICS, geometry_table
from reports.tables.selection import Asked

ROOT = Path(__file__).parents[3]
RECORDS = RunStore(Path(__file__).parents[2] / "golden" / "run").records()
#: Where the stored averages differ from the printed table by more than 0.02: stored, printed.
DIFFERENT = {
    ("mexecon8", "normal_error"): (34.86, 39.54),
    ("vggt8", "chamfer"): (23.69, 23.87),
    ("vggt8", "p2s_completeness"): (19.45, 19.84),
}


def test_the_abstract_of_the_paper_follows_from_its_table():
    econ, _, mexecon, _ = PUBLISHED["geometry"].rows
    drop = 1 - mexecon.cells["chamfer"].value / econ.cells["chamfer"].value
    assert drop == pytest.approx(0.42, abs=0.01)  # "reduces the Chamfer Distance by 42 %"
    first, _, last = PUBLISHED["jmbo"].rows
    drop = 1 - last.cells["total_loss"].value / first.cells["total_loss"].value
    assert drop == pytest.approx(0.74, abs=0.005)  # "reduced by over 74 %"


@pytest.mark.parametrize("name", PUBLISHED)
def test_every_printed_row_fills_the_printed_columns(name):
    block = PUBLISHED[name]
    assert all(set(row.cells) == set(block.columns) for row in block.rows)


def test_the_printed_geometry_has_our_columns():
    assert tuple(PUBLISHED["geometry"].columns) == GEOMETRY_METRICS


@pytest.mark.parametrize("make", [geometry_table, cost_table])
def test_printed_numbers_are_shown_on_request_only_and_never_bold(make):
    plain, shown = make(RECORDS), make(RECORDS, Asked(published=True))
    assert plain.rows == shown.rows
    assert "ECON &" not in to_latex(plain)
    below = to_latex(shown).split("Published, not measured here")[1]
    assert "ECON &" in below
    assert r"\textbf" not in below


def published_json(**options):
    return json.loads(build_published(ReportRequest(table="published", format="json", **options)))


def test_every_subject_of_the_paper_has_a_record_and_the_missing_ones_are_named():
    listed = load_manifest(ROOT / "data_manifest.yaml").datasets["thuman21"].subjects
    assert listed == SUBJECTS
    records = stored_records()
    assert len(records) == 4 * 20
    missing = {(r.method_name, r.subject) for r in records if r.status == "missing"}
    assert missing == {
        *((method, subject) for method in STORED_METHODS for subject in ("0074", "0083")),
        ("vggt8", "0021"),
    }


@pytest.mark.parametrize("method", STORED_METHODS)
def test_stored_averages_are_means_and_differ_from_the_print_only_where_that_is_said(method):
    printed = next(r for r in PUBLISHED["geometry"].rows if r.title == STORED_METHODS[method])
    ok = [r for r in stored_records() if r.method_name == method and r.status == "ok"]
    for metric in GEOMETRY_METRICS:
        mean = sum(record.metrics[metric].value for record in ok) / len(ok)
        assert stored_averages(method)[metric] == pytest.approx(mean, rel=1e-9)
        text = printed.cells[metric].value
        if (method, metric) in DIFFERENT:
            assert (round(mean, 2), text) == DIFFERENT[method, metric]
        else:
            assert mean == pytest.approx(text, abs=0.02)


def test_the_provenance_names_what_differs_and_what_is_missing():
    page = (ROOT / "reports/published/PROVENANCE.md").read_text(encoding="utf-8")
    for stored, printed in DIFFERENT.values():
        assert f"| {stored} | {printed} |" in page
    for subject in ("0074", "0083", "0021"):
        assert subject in page
    assert "0.82 units high" in page


def test_means_stand_beside_the_printed_values():
    document = published_json()
    rows = {row["title"]: row for row in document["rows"]}
    assert [(title, row["n"], row["of"]) for title, row in rows.items()] == [
        ("ECON", 18, 20), ("2-view MExECON", 18, 20), ("8-view MExECON", 18, 20),
        ("8-view VGGT", 17, 20),
    ]  # fmt: skip
    assert rows["8-view VGGT"]["metrics"]["chamfer"]["mean"] == pytest.approx(23.687, abs=5e-4)
    assert all(row["best"] == [] for row in rows.values()), "other subjects are no ranking"
    printed = {row["title"]: row["metrics"] for row in document["published"]["rows"]}
    assert printed["8-view VGGT"]["chamfer"]["text"] == "23.87"
    assert "not measured here" in document["origin"]


def test_eight_views_and_vggt_cannot_be_told_apart():
    document = published_json(paired=True)
    rows = {row["method"]: row for row in document["rows"]}
    assert list(rows) == ["econ", "mexecon2", "mexecon8"]
    row = rows["mexecon8"]
    chamfer = row["metrics"]["chamfer"]
    assert row["n"] == 17
    assert chamfer["mean"] == pytest.approx(-0.31, abs=0.005)
    assert chamfer["low"] == pytest.approx(-6.6, abs=0.15)
    assert chamfer["high"] == pytest.approx(4.3, abs=0.1)
    assert row["metrics"]["chamfer_lower_on"]["mean"] == pytest.approx(100 * 6 / 17)
    assert row["metrics"]["chamfer_p"]["mean"] > 0.5
    assert any("8-view MExECON 6 of 17" in remark for remark in document["remarks"])
    # ECON differs from VGGT beyond chance.
    assert rows["econ"]["metrics"]["chamfer"]["low"] > 0


def test_other_pairs_and_fewer_subjects_on_request():
    document = published_json(paired=True, methods=("mexecon2", "mexecon8"))
    (row,) = document["rows"]
    assert (row["method"], row["n"]) == ("mexecon8", 18)
    assert row["metrics"]["chamfer"]["mean"] == pytest.approx(23.1235 - 32.7590, abs=1e-3)
    few = published_json(subjects=("0004", "0021"), methods=("vggt8",))["rows"][0]
    assert (few["n"], few["of"]) == (1, 2)
    assert few["metrics"]["chamfer"]["mean"] == pytest.approx(21.326142, abs=1e-6)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"methods": ("mexecon9",)}, "no published method 'mexecon9'.*mexecon8"),
        ({"subjects": ("0008",)}, "no published subject '0008'"),
        ({"methods": ("econ",), "paired": True}, "two published methods.*got econ"),
        ({"subjects": ("0074",), "paired": True}, "no method has the numbers.*'published'"),
        ({"format": "latx"}, "unknown format 'latx'"),
    ],
)
def test_what_was_not_published_cannot_be_shown(options, match):
    with pytest.raises(HarnessError, match=match):
        build_published(ReportRequest(table="published", **options))


def test_paired_is_for_the_published_results_alone():
    with pytest.raises(HarnessError, match="--paired.*--table paired"):
        build_table(RECORDS, ReportRequest(table="geometry", paired=True))
    with pytest.raises(HarnessError, match="Did you mean 'published'"):
        build_table(RECORDS, ReportRequest(table="publishd"))


def one_line(text):
    return " ".join(text.split())


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("paired", [False, True])
def test_every_format_of_the_published_table_has_the_unit_and_the_printed_values(form, paired):
    text = build_published(ReportRequest(table="published", format=form, paired=paired))
    assert text.endswith("\n")
    assert "39.54" in text
    assert "likely thousandths of a scan unit" in text
    assert UNIT_NOTE in one_line(text)
    assert "measured here" in text or form == "csv"


@pytest.mark.parametrize("form", FORMATS)
def test_wherever_printed_numbers_stand_beside_ours_their_unit_does(form):
    request = ReportRequest(format=form, published=True, methods=("hull8", "gt"))
    assert UNIT_NOTE in one_line(build_table(RECORDS, request))


def test_lines_of_csv_say_what_they_are():
    text = build_published(ReportRequest(table="published", format="csv", paired=True))
    lines = list(csv.DictReader(io.StringIO(text)))
    assert [line["block"] for line in lines] == ["stored"] * 3 + ["published"] * 4
    assert all("Minus 8-view VGGT" in line["notes"] for line in lines[:3])
    assert all("means, not differences" in line["notes"] for line in lines[3:])
    assert {line["protocol"] for line in lines} == {""}
