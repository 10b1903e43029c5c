"""Methods are compared subject by subject: differences, shares, Holm's p-values, in closed form."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.core.privileges import Privilege
from harness.core.records import CaptureStamp
from harness.pipeline.run.store import RunStore
from reports.tables.geometry import GEOMETRY_METRICS
from reports.tables.paired import paired_table

RECORDS = RunStore(Path(__file__).parents[3] / "golden" / "run").records()
TEMPLATE = next(record for record in RECORDS if record.method_name == "hull8")
SIX = [f"a{index:02d}" for index in range(1, 7)]


def scored(method, values, subjects=SIX, **given):
    """Records of a method whose metrics all have one value per subject."""
    described = replace(TEMPLATE.method, name=method, title=method.upper(), **given)
    return [
        replace(
            TEMPLATE,
            method=described,
            subject=subject,
            capture=CaptureStamp(),
            metrics={m: replace(TEMPLATE.metrics[m], value=value) for m in GEOMETRY_METRICS},
        )
        for subject, value in zip(subjects, values, strict=True)
    ]


def table_of(*records, **options):
    return paired_table([r for group in records for r in group], **options)


HARD = scored("base", [10.0, 20.0, 30.0, 40.0, 50.0, 60.0])


def test_a_small_gain_on_every_subject_is_seen_through_a_large_spread():
    better = scored("better", [9.0, 19.0, 29.0, 39.0, 49.0, 59.0])
    (row,) = table_of(HARD, better).rows
    assert row.method == "better"
    assert row.cells["chamfer"].value == pytest.approx(-1.0)
    assert row.cells["chamfer_lower_on"].value == 100
    # Two of 2^6 patterns of signs are as extreme; four cells are claimed at once.
    assert row.cells["chamfer_p"].value == pytest.approx(4 * 2 / 64)


def test_only_subjects_that_both_have_are_compared():
    fewer = scored("fewer", [12.0, 18.0], subjects=["a01", "a02"])
    failed = [replace(HARD[2], method=fewer[0].method, status="failed", reason="x", metrics={})]
    (row,) = table_of(HARD, fewer, failed).rows
    assert (row.n, row.of) == (2, 6)
    assert row.cells["normal_error"].value == pytest.approx(0.0)
    assert row.cells["normal_error_lower_on"].value == 50


def test_an_interval_is_of_the_differences_and_not_of_the_means():
    better = scored("better", [9.0, 18.0, 29.0, 38.0, 49.0, 58.0])
    (row,) = table_of(HARD, better, interval=lambda v: (min(v), max(v))).rows
    assert (row.cells["chamfer"].low, row.cells["chamfer"].high) == (-2.0, -1.0)


def test_holm_raises_each_p_value_by_the_claims_that_are_left():
    clear = scored("clear", [value - 1 for value in (10, 20, 30, 40, 50, 60)])
    mixed = scored("mixed", [11.0, 19.0, 31.0, 39.0, 51.0, 59.0])
    first, second = table_of(HARD, clear, mixed).rows
    # Eight cells: four with 2/64 come first; by the order of equals each is raised as the first is.
    assert first.cells["p2s_accuracy_p"].value == pytest.approx(8 * 2 / 64)
    assert second.cells["p2s_accuracy_p"].value == 1.0


def test_the_first_method_asked_for_is_compared_against_and_the_truth_never():
    other = scored("other", [11.0, 21.0, 31.0, 41.0, 51.0, 61.0])
    truth = scored("truth", [0.0] * 6, privileges=(Privilege.GROUND_TRUTH_MESH,))
    table = table_of(HARD, other, truth, methods=("truth", "other", "base"))
    assert [row.method for row in table.rows] == ["base"]
    assert table.rows[0].cells["chamfer"].value == pytest.approx(-1.0)
    assert table.title == "Difference from OTHER"
    assert table.rows[0].notes[0] == "Minus OTHER"


def test_what_may_be_chance_is_named():
    mixed = scored("mixed", [11.0, 19.0, 31.0, 39.0, 51.0, 59.0])
    assert "May be chance: MIXED (Chamfer p 1, " in table_of(HARD, mixed).caption
    certain = scored("certain", [value - 1 for value in range(10, 150, 10)], subjects=range(14))
    base = scored("base", range(10, 150, 10), subjects=range(14))
    assert "May be chance: none." in table_of(base, certain).caption


def test_one_method_alone_has_nothing_to_be_compared_with():
    table = table_of(HARD)
    assert table.rows == ()
    assert table.remarks[-1] == "No two methods have numbers on one subject"
