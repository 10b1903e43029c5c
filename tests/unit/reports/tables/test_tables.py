"""Records become rows: what is averaged, what is refused, what stays visible."""

import random
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.protocols import Part, Privilege
from harness.core.records import CaptureStamp, MetricValue, ProtocolStamp
from harness.run.store import RunStore
from reports.tables.geometry import geometry_table
from reports.tables.selection import Asked
from reports.tables.table import footnote_mark

RUN = Path(__file__).parents[3] / "golden" / "run"
RECORDS = RunStore(RUN).records()


def of_method(name):
    return [record for record in RECORDS if record.method_name == name]


def with_chamfer(record, value, unit="mm"):
    metrics = {**record.metrics, "chamfer": MetricValue(value, unit, 60000, 0.02)}
    return replace(record, metrics=metrics)


def row_of(table, method):
    return next(row for row in table.rows if row.method == method)


def column_of(table, metric):
    return next(column for column in table.columns if column.id == metric)


def test_a_cell_is_the_mean_over_the_subjects_that_succeeded():
    records = of_method("mexecon")
    values = [r.metrics["chamfer"].value for r in records if r.status == "ok"]
    row = row_of(geometry_table(records), "mexecon")
    assert row.cells["chamfer"].value == fmean(values)
    assert (row.n, row.of) == (2, 3)


def test_a_failed_subject_is_named_with_its_reason():
    row = row_of(geometry_table(of_method("mexecon")), "mexecon")
    assert any("1 of 3 failed: no person was found" in note and "a02" in note for note in row.notes)


def test_a_subject_without_a_record_still_counts():
    records = [*of_method("hull8")[:2], *of_method("gt")]
    row = row_of(geometry_table(records), "hull8")
    assert (row.n, row.of) == (2, 3)
    assert "1 of 3 not run (a03)" in row.notes


def test_choosing_methods_does_not_shrink_the_set_of_subjects():
    records = [*of_method("hull8")[:1], *of_method("gt")]
    assert row_of(geometry_table(records, Asked(methods=["hull8"])), "hull8").of == 3


def test_a_method_without_any_record_keeps_its_place():
    table = geometry_table(RECORDS, Asked(methods=["hull8", "econ"]))
    assert [row.method for row in table.rows] == ["hull8", "econ"]
    assert (table.rows[1].n, table.rows[1].of, table.rows[1].cells) == (0, 3, {})
    assert table.rows[1].notes == ("3 of 3 not run (a01, a02, a03)",)


def test_rows_stand_as_asked():
    order = ["gt", "vggt", "hull8", "mexecon"]
    assert [row.method for row in geometry_table(RECORDS, Asked(methods=order)).rows] == order


def test_only_the_subjects_asked_for_count():
    table = geometry_table(RECORDS, Asked(subjects=["a02"]))
    assert [(row.n, row.of) for row in table.rows] == [(1, 1), (1, 1), (0, 1), (0, 1)]


@given(st.randoms(use_true_random=False))
def test_the_order_of_records_does_not_matter(shuffler: random.Random):
    shuffled = list(RECORDS)
    shuffler.shuffle(shuffled)
    order = ["hull8", "mexecon", "vggt", "gt"]
    assert geometry_table(shuffled, Asked(methods=order)) == geometry_table(
        RECORDS, Asked(methods=order)
    )


def test_the_best_is_compared_after_rounding_and_ties_are_all_best():
    first, second = of_method("hull8")[0], of_method("mexecon")[0]
    table = geometry_table([with_chamfer(first, 12.344), with_chamfer(second, 12.3391)])
    column = column_of(table, "chamfer")
    assert all(table.is_best(row, column) for row in table.rows)
    table = geometry_table([with_chamfer(first, 12.346), with_chamfer(second, 12.3391)])
    assert [table.is_best(row, column) for row in table.rows] == [False, True]


def test_a_row_that_was_given_the_answer_is_never_best():
    table = geometry_table(RECORDS)
    truth = row_of(table, "gt")
    assert truth.cells["p2s_accuracy"].value == 0
    assert not any(table.is_best(truth, column) for column in table.columns)
    assert table.is_best(row_of(table, "hull8"), column_of(table, "p2s_accuracy"))


def with_chamfers(method, by_subject):
    """A method's records with these values; a subject without one failed."""
    made = []
    for record in of_method("hull8"):
        value = by_subject.get(record.subject)
        named = replace(record, method=replace(record.method, name=method, title=method))
        failed = replace(named, status="failed", reason="it fell over", metrics={})
        made.append(failed if value is None else with_chamfer(named, value))
    return made


def test_the_best_is_told_on_the_subjects_that_all_ranked_rows_have():
    """Who fails on the hard subject has the lower mean, and is not the better for it."""
    careful = with_chamfers("careful", {"a01": 10.0, "a02": 10.0, "a03": 70.0})
    fragile = with_chamfers("fragile", {"a01": 20.0, "a02": 20.0})
    table = geometry_table([*careful, *fragile, *of_method("gt"), *of_method("vggt")])
    column = column_of(table, "chamfer")
    best = {row.method: table.is_best(row, column) for row in table.rows}
    means = [row_of(table, name).cells["chamfer"].value for name in ("careful", "fragile")]
    assert means == [30.0, 20.0]
    assert best == {"careful": True, "fragile": False, "gt": False, "vggt": False}
    assert table.common_subjects(column) == ("a01", "a02")
    assert "bold by the means on the 2 subjects that all ranked rows with num" in table.caption
    notes = {row.method: [text for text in row.notes if "On the" in text] for row in table.rows}
    (note,) = notes.pop("careful")
    assert "Chamfer 10.00 mm, P2S Acc." in note
    assert not any(notes.values())


def test_rows_without_a_common_subject_are_not_ranked():
    first = with_chamfers("first", {"a01": 1.0})
    second = with_chamfers("second", {"a02": 2.0, "a03": 2.0})
    table = geometry_table([*first, *second])
    assert not any(table.is_best(row, column) for row in table.rows for column in table.columns)
    assert "where ranked rows have a subject in common: none here" in table.caption


def test_rows_of_the_same_subjects_are_ranked_by_what_is_printed():
    values = {"a01": 10.0, "a03": 20.0}
    table = geometry_table([*with_chamfers("first", values), *with_chamfers("second", values)])
    assert table.uneven == ()
    assert "best in bold. " in table.caption
    assert not any("On the" in note for row in table.rows for note in row.notes)
    assert all(table.is_best(row, column_of(table, "chamfer")) for row in table.rows)


def test_a_row_that_is_not_ranked_takes_no_subject_from_the_others():
    truth = [record for record in of_method("gt") if record.subject == "a02"]
    table = geometry_table([*of_method("hull8"), *truth])
    assert table.common_subjects(column_of(table, "chamfer")) == ("a01", "a02", "a03")
    assert table.uneven == ()


def test_the_floor_is_that_of_the_truths_whatever_the_rows():
    """Each subject's counts once, however many methods were measured on it."""
    scored = fmean(record.metrics["chamfer"].value for record in of_method("gt"))
    for records in (RECORDS, of_method("gt"), [*of_method("hull8"), *of_method("mexecon")]):
        assert f"mean over subjects: {scored:.2f} mm" in geometry_table(records).caption
    table = geometry_table(RECORDS)
    assert row_of(table, "gt").cells["chamfer"].value == pytest.approx(scored)


def test_an_interval_needs_two_subjects():
    spread = lambda values: (min(values), max(values))  # noqa: E731
    cell = geometry_table(of_method("hull8"), Asked(interval=spread)).rows[0].cells["chamfer"]
    assert (cell.low, cell.high) == (13.078, 16.333)
    cell = geometry_table(of_method("hull8")[:1], Asked(interval=spread)).rows[0].cells["chamfer"]
    assert (cell.low, cell.high) == (None, None)


CHANGES = {
    "dataset": {"dataset": "thuman21"},
    "recipe": {"recipe": "paper8"},
    "protocol": {"protocol": ProtocolStamp("exact", 1, "ffff")},
    "capture of a01": {"capture": CaptureStamp("another")},
}


@pytest.mark.parametrize("what", CHANGES)
def test_records_that_do_not_compare_are_refused(what):
    hull, mexecon = of_method("hull8")[0], replace(of_method("mexecon")[0], **CHANGES[what])
    with pytest.raises(ProtocolMismatch) as refusal:
        geometry_table([hull, mexecon])
    text = str(refusal.value)
    assert what in text
    assert "hull8/a01" in text
    assert "mexecon/a01" in text
    assert "evaluate again" in text


def test_the_same_protocol_in_another_version_is_another_protocol():
    hull, mexecon = of_method("hull8")[0], of_method("mexecon")[0]
    newer = replace(mexecon, protocol=replace(mexecon.protocol, version=2, sha="ffff"))
    with pytest.raises(ProtocolMismatch, match="version 2"):
        geometry_table([hull, newer])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("views", (7,)),
        ("parts", (Part("body model", "another", "MIT"),)),
        ("privileges", (Privilege.SUBJECT_CENTRE,)),
        ("parameters", {"hull": {"voxel_m": 7.0}}),
    ],
)
def test_two_states_of_a_method_are_not_averaged(field, value):
    first, second = of_method("hull8")[:2]
    other = replace(second, method=replace(second.method, **{field: value}))
    with pytest.raises(ProtocolMismatch, match=f"hull8/a01 and hull8/a02 .* {field} differ"):
        geometry_table([first, other])


def test_a_failed_record_of_an_older_state_does_not_stop_the_table():
    first, second = of_method("hull8")[:2]
    older = replace(second.method, parameters={"hull": {"voxel_m": 0.1}})
    failed = replace(second, method=older, status="failed", reason="no disk", metrics={})
    assert geometry_table([first, failed]).rows[0].n == 1


def test_a_mesh_made_elsewhere_has_no_photos_and_says_so():
    record = of_method("hull8")[0]
    scored = replace(
        record,
        recipe="",
        capture=CaptureStamp(),
        method=replace(record.method, name="mine", title="Mine", privileges=()),
    )
    table = geometry_table([scored, record])
    assert row_of(table, "mine").notes == ("Meshes made elsewhere",)
    assert table.recipe == "quick8"


def test_two_records_of_one_cell_are_refused():
    record = of_method("hull8")[0]
    with pytest.raises(HarnessError, match="two records of hull8/a01"):
        geometry_table([record, record])


def test_a_record_in_another_unit_is_refused():
    with pytest.raises(ProtocolMismatch, match=r"chamfer of hull8/a01 .*expected mm; got cm"):
        geometry_table([with_chamfer(of_method("hull8")[0], 1.2, unit="cm")])


def test_a_record_without_a_metric_is_refused():
    record = of_method("hull8")[0]
    metrics = {name: value for name, value in record.metrics.items() if name != "normal_error"}
    with pytest.raises(ProtocolMismatch, match="hull8/a01 has no normal_error"):
        geometry_table([replace(record, metrics=metrics)])


def test_nothing_to_report_says_what_there_is():
    with pytest.raises(HarnessError, match="Run 'harness eval' first"):
        geometry_table([])
    with pytest.raises(HarnessError, match=r"no records of hull9 .* hull8"):
        geometry_table(of_method("hull8"), Asked(methods=["hull9"]))


def test_the_caption_says_what_was_measured_and_how():
    table = geometry_table(RECORDS)
    for part in ("avatars", "3 subjects", "quick8", "mexecon version 2", table.protocol.sha):
        assert str(part) in table.caption
    assert "n/N" in table.caption
    assert "n/N" not in geometry_table(of_method("hull8")).caption


def test_rows_share_a_footnote_only_when_its_text_is_the_same():
    table = geometry_table(RECORDS)
    hull, mexecon = row_of(table, "hull8"), row_of(table, "mexecon")
    shared = set(table.marks(hull)) & set(table.marks(mexecon))
    assert [text for text, mark in table.footnotes.items() if mark in shared] == [
        "Given: known cameras"
    ]
    assert len(set(table.footnotes.values())) == len(table.footnotes)


def test_footnote_marks_go_on_after_z():
    marks = [footnote_mark(index) for index in range(703)]
    assert marks[:2] == ["a", "b"]
    assert marks[25:28] == ["z", "aa", "ab"]
    assert marks[701:] == ["zz", "aaa"]
    assert len(set(marks)) == len(marks)
