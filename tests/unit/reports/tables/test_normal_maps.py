"""The normals table: rows by photo and side, means over subjects, and what has no labels."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import pytest

from harness.core.errors import DataError
from harness.core.protocols import Part
from harness.core.records import AngularErrors, AngularPair, FoldErrors, NormalMapErrors
from harness.run.store import RunStore
from reports.formats.latex import to_latex, to_markdown
from reports.formats.programs import to_csv, to_json
from reports.tables.normals import headline, normals_table
from reports.tables.selection import Asked

RUN = Path(__file__).parents[3] / "golden" / "run"
RECORDS = [r for r in RunStore(RUN).records() if r.method_name in ("mexecon", "hull8")]
SUBJECTS = [r.subject for r in RECORDS if r.method_name == "mexecon" and r.status == "ok"]


def summary(mean, n=1000):
    return AngularErrors(mean, mean / 2, 0.25, 0.5, 0.75, n)


def entry(view, side, estimate, body, *, labelled=True):
    """The whole subject is 1 degree better than its clothes."""
    clothed = AngularPair(summary(estimate), summary(body))
    whole = AngularPair(summary(estimate - 1, 1500), summary(body - 1, 1500))
    folds = FoldErrors(estimate / 4, body / 2, 0.5) if side == "near" else None
    return NormalMapErrors(view, 45.0 * view, side, clothed if labelled else None, whole, folds)


def with_maps(entries, method="mexecon"):
    """The golden records, those of one method with errors of normal maps."""
    return [
        replace(r, normal_maps=tuple(entries(r.subject)))
        if r.method_name == method and r.status == "ok"
        else r
        for r in RECORDS
    ]


def four(subject):
    more = SUBJECTS.index(subject)
    return [
        entry(0, "near", 10.0 + 4 * more, 20.0 + 4 * more),
        entry(0, "far", 18.0, 20.0),
        entry(4, "near", 12.0, 24.0),
        entry(4, "far", 19.0, 20.0),
    ]


def rows(table):
    return {row["title"]: row for row in json.loads(to_json(table))["rows"]}


def test_one_row_per_photo_and_side_what_is_seen_first():
    table = normals_table(with_maps(four))
    names = [row.title.split(": ")[1] for row in table.rows]
    assert names == [
        "front photo, near side",
        "back photo, near side",
        "front photo, far side",
        "back photo, far side",
    ]
    assert {row.method for row in table.rows} == {"mexecon"}


def test_cells_are_means_over_subjects_and_the_ratio_is_that_of_the_means():
    assert len(SUBJECTS) > 1
    mean = 2.0 * (len(SUBJECTS) - 1)
    cells = next(iter(rows(normals_table(with_maps(four))).values()))["metrics"]
    assert cells["error"]["mean"] == pytest.approx(10 + mean)
    assert cells["body_error"]["mean"] == pytest.approx(20 + mean)
    assert cells["ratio"]["mean"] == pytest.approx((10 + mean) / (20 + mean))
    assert cells["median"]["mean"] == pytest.approx((10 + mean) / 2)
    assert cells["below_22_5"]["mean"] == 50.0
    assert cells["all_error"]["mean"] == pytest.approx(9 + mean)
    assert cells["all_body_error"]["mean"] == pytest.approx(19 + mean)
    assert cells["pixels"]["mean"] == 1000


def test_folds_are_a_share_of_the_scans_where_records_have_them():
    table = normals_table(with_maps(four))
    mean = 2.0 * (len(SUBJECTS) - 1)
    near, _, far, _ = (row.cells for row in table.rows)
    assert near["folds"].value == pytest.approx((10 + mean) / 4)
    assert near["true_folds"].value == pytest.approx((20 + mean) / 2)
    assert near["folds_share"].value == pytest.approx(50 * (10 + mean) / (20 + mean))
    assert near["fold_correlation"].value == 0.5
    assert "folds" not in far
    assert "Folds (%)" in to_markdown(table)
    bare = [
        replace(r, normal_maps=tuple(replace(e, folds=None) for e in r.normal_maps))
        for r in with_maps(four)
    ]
    assert "olds" not in to_markdown(normals_table(bare))


def test_without_labels_the_row_says_that_all_pixels_count():
    table = normals_table(with_maps(lambda _: [entry(0, "near", 10.0, 20.0, labelled=False)]))
    [row] = rows(table).values()
    assert row["metrics"]["error"]["mean"] == row["metrics"]["all_error"]["mean"] == 9.0
    assert row["metrics"]["pixels"]["mean"] == 1500
    assert any("without labels" in note for note in row["notes"])
    labelled = normals_table(with_maps(four))
    assert not any("without labels" in note for row in labelled.rows for note in row.notes)


def test_a_side_without_a_clothed_pixel_shows_a_dash():
    none = AngularErrors(None, None, None, None, None, 0)
    bare = replace(entry(0, "near", 1, 2), clothed=AngularPair(none, none))
    [row] = rows(normals_table(with_maps(lambda _: [bare]))).values()
    assert row["metrics"]["error"]["mean"] is None
    assert row["metrics"]["ratio"]["mean"] is None
    assert row["metrics"]["all_error"]["mean"] == 0.0


def test_the_estimator_and_the_methods_without_maps_are_named():
    records = with_maps(four)
    parts = (Part("normal estimator", "net 1", "MIT"),)
    records = [
        replace(r, method=replace(r.method, parts=parts)) if r.method_name == "mexecon" else r
        for r in records
    ]
    caption = normals_table(records).caption
    assert "Estimators: net 1 (" in caption
    assert "Without normal maps" in caption
    assert "Visual hull" in caption
    assert normals_table(RECORDS).rows == ()


def test_print_is_narrow_and_files_have_everything():
    table = normals_table(
        with_maps(four), Asked(interval=lambda values: (min(values), max(values)))
    )
    header = next(line for line in to_markdown(table).splitlines() if line.startswith("| Method"))
    assert header.count("(deg)") == 4
    assert header.count("(%)") == 4
    assert r"$<11.25^\circ$" in to_latex(table)
    assert to_latex(table).isascii()
    lines = list(csv.DictReader(io.StringIO(to_csv(table))))
    assert len(lines) == 4
    assert float(lines[2]["error_mean_deg"]) == pytest.approx(18.0)
    assert float(lines[2]["all_body_below_30_mean_%"]) == 75.0


def test_a_figure_is_told_the_means_over_clothes_or_over_everything():
    records = with_maps(four)
    record = next(r for r in records if r.subject == SUBJECTS[0] and r.method_name == "mexecon")
    found = headline(record, 4, "near")
    assert (found.photo, found.estimate, found.body) == ("back photo", "12.0° off", "24.0° off")
    [bare] = [entry(2, "far", 10.0, 20.0, labelled=False)]
    other = headline(replace(record, normal_maps=(bare,)), 2, "far")
    assert (other.photo, other.estimate) == ("photo at 90°", "9.0° off")
    with pytest.raises(DataError, match="view 3, near side"):
        headline(record, 3, "near")
