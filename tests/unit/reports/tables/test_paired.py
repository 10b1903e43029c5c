"""Methods are compared subject by subject: differences, shares, Holm's p-values, in closed form."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.protocols import Part, Privilege
from harness.core.records import CaptureStamp
from harness.run.store import RunStore
from reports.tables.geometry import GEOMETRY_METRICS
from reports.tables.paired import change_table, paired_table
from reports.tables.selection import Asked

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
    return paired_table([r for group in records for r in group], Asked(**options))


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


def test_each_method_is_compared_with_itself_before():
    old, new = (Part("normal estimator", name, "MIT") for name in ("old", "new"))
    before = [*scored("one", [10.0, 20.0, 30.0, 40.0, 50.0, 60.0], parts=(old,)), *HARD]
    after = [*scored("one", [8.0, 19.0, 28.0, 39.0, 48.0, 59.0], parts=(new,)), *HARD]
    table = change_table(after, before, Asked(interval=lambda v: (min(v), max(v))))

    assert table.title == "Difference from the same method before"
    first, second = table.rows
    assert (first.method, second.method) == ("one", "base")
    chamfer = first.cells["chamfer"]
    assert (chamfer.value, chamfer.low, chamfer.high) == (pytest.approx(-1.5), -2.0, -1.0)
    assert first.cells["chamfer_lower_on"].value == 100
    assert second.cells["chamfer"].value == 0.0
    assert first.notes[0] == "Minus ONE, before"
    assert "Before: Parts: normal estimator old (MIT)" in first.notes
    assert "Parts: normal estimator new (MIT)" in first.notes
    assert not [note for note in second.notes if note.startswith("Before: ")]


def test_methods_that_are_new_are_named_and_left_out():
    new = scored("new", [1.0] * 6)
    table = change_table([*HARD, *new], HARD)

    assert [row.method for row in table.rows] == ["base"]
    assert "Not in the records before: new" in table.remarks
    with pytest.raises(HarnessError, match="have none of these methods"):
        change_table(new, HARD)


def test_other_photos_are_not_compared_with_those_before():
    photos = [replace(record, capture=CaptureStamp(key="0" * 16)) for record in HARD]
    other = [replace(record, capture=CaptureStamp(key="1" * 16)) for record in HARD]
    with pytest.raises(ProtocolMismatch, match="capture of a0"):
        change_table(photos, other)
