"""The regression check: what moves it, what does not, and what it says."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.core.errors import DataError, HarnessError, ProtocolMismatch
from harness.core.records import (
    AngularErrors,
    AngularPair,
    FoldErrors,
    MetricValue,
    NormalMapErrors,
    ProtocolStamp,
)
from harness.run.store import RunStore
from reports.regression.baseline import (
    Baseline,
    Tolerance,
    Value,
    inputs_of,
    update,
)
from reports.regression.compare import compare, to_markdown, to_text, with_spread

RECORDS = RunStore(Path(__file__).parents[3] / "golden" / "run").records()
HULL = [record for record in RECORDS if record.method_name == "hull8"]
NUMBERS = sum(len(record.metrics) for record in RECORDS)


def with_chamfer(record, value, unit="mm"):
    metrics = {**record.metrics, "chamfer": MetricValue(value, unit, 60000, 0.02)}
    return replace(record, metrics=metrics)


def baseline_of(records, absolute=0.05, relative=0.01):
    made = update(records)
    return replace(
        made, tolerances={**made.tolerances, "chamfer": Tolerance(absolute, relative, "mm")}
    )


def test_nothing_changed():
    comparison = compare(RECORDS, update(RECORDS))
    assert comparison.passed
    assert comparison.unchanged == NUMBERS
    assert comparison == replace(comparison, moved=(), missing=(), new=(), changed=())
    assert to_text(comparison).startswith("passed: 0 moved, 0 missing, 0 new, ")


def test_a_baseline_survives_its_file(tmp_path):
    made = update(RECORDS)
    path = tmp_path / "baseline.json"
    made.save(path)
    assert Baseline.load(path) == made
    assert compare(RECORDS, Baseline.load(path)).passed


def test_a_moved_number_fails_and_is_shown_with_its_allowance():
    base = baseline_of([with_chamfer(HULL[0], 20.0)])
    comparison = compare([with_chamfer(HULL[0], 20.26)], base)
    assert not comparison.passed
    (moved,) = comparison.moved
    assert (moved.method, moved.subject, moved.metric, moved.unit) == (
        "hull8",
        "a01",
        "chamfer",
        "mm",
    )
    assert moved.allowed == pytest.approx(0.05 + 0.01 * 20.0)
    assert moved.change == pytest.approx(0.26)
    for text in (to_text(comparison), to_markdown(comparison)):
        assert "FAILED: 1 moved" in text
        for part in ("hull8", "a01", "chamfer", "20.000", "20.260", "+0.260", "0.250", "mm"):
            assert part in text


@given(
    before=st.floats(-1e3, 1e3),
    change=st.floats(-50, 50),
    absolute=st.floats(0, 10),
    relative=st.floats(0, 0.5),
)
def test_moved_means_more_than_absolute_plus_relative(before, change, absolute, relative):
    after = before + change
    base = baseline_of([with_chamfer(HULL[0], before)], absolute, relative)
    comparison = compare([with_chamfer(HULL[0], after)], base)
    assert comparison.passed == (abs(after - before) <= absolute + relative * abs(before))


def test_an_improvement_moves_too():
    base = baseline_of([with_chamfer(HULL[0], 20.0)])
    assert not compare([with_chamfer(HULL[0], 10.0)], base).passed


def test_not_a_number_is_never_unchanged():
    base = baseline_of([with_chamfer(HULL[0], 20.0)])
    assert not compare([with_chamfer(HULL[0], float("nan"))], base).passed


def test_a_missing_record_fails():
    comparison = compare(HULL[:2], update(HULL))
    assert not comparison.passed
    (missing,) = comparison.missing
    assert (missing.subject, missing.reason) == ("a03", "no record")
    assert "no record" in to_text(comparison)


def test_cells_that_the_run_has_are_checked_alone_unless_all_are_asked_for():
    base, names = update(RECORDS), {record.method_name for record in RECORDS}
    others = ", ".join(sorted(names - {"hull8"}))

    partly = compare(HULL, base, every=False)
    assert partly.passed
    assert to_text(partly).endswith(
        f"checked: hull8; not in the run: {others} (--all asks for them)\n"
    )
    fewer = to_text(compare(HULL[:2], base, every=False))
    assert "checked: hull8 on a01 and a02; not in the run: " in fewer
    assert "hull8 on a03" in fewer
    assert not compare([with_chamfer(HULL[0], 30.0)], base, every=False).passed
    assert not compare(HULL, base).passed


def test_a_record_that_fails_now_is_missing_with_its_reason():
    failed = replace(HULL[0], status="failed", reason="no disk\nlog tail", metrics={})
    comparison = compare([failed, *HULL[1:]], update(HULL))
    assert [missing.reason for missing in comparison.missing] == ["failed: no disk"]
    assert "failed: no disk" in to_markdown(comparison)


def test_a_metric_that_is_gone_is_missing():
    metrics = {name: value for name, value in HULL[0].metrics.items() if name != "chamfer"}
    comparison = compare([replace(HULL[0], metrics=metrics)], update(HULL[:1]))
    assert [missing.metric for missing in comparison.missing] == ["chamfer"]


def test_a_new_number_is_told_and_passes():
    comparison = compare(HULL, update(HULL[:2]))
    assert comparison.passed
    assert {(method, subject) for method, subject, _ in comparison.new} == {("hull8", "a03")}
    assert "4 new" in to_text(comparison)


def test_what_failed_in_the_baseline_too_is_unchanged():
    failed = [record for record in RECORDS if record.status != "ok"]
    assert failed
    comparison = compare(failed, update(failed))
    assert comparison.passed
    assert comparison.unchanged == 0


def test_a_changed_input_is_named_though_no_number_moved():
    method = replace(HULL[0].method, parameters={"hull": {"voxel_m": 0.008}})
    other = replace(HULL[0], key="0123456789abcdef", method=method)
    comparison = compare([other], update(HULL[:1]))
    assert comparison.passed
    (changed,) = comparison.changed
    assert changed.inputs == {"method.parameters.hull.voxel_m": ("0.004", "0.008")}
    for text in (to_text(comparison), to_markdown(comparison)):
        assert "01234567" in text
        assert "method.parameters.hull.voxel_m" in text


def test_another_package_is_named():
    packages = {**HULL[0].environment.packages, "open3d": "0.21.0"}
    other = replace(HULL[0], environment=replace(HULL[0].environment, packages=packages))
    (changed,) = compare([other], update(HULL[:1])).changed
    assert changed.inputs == {"packages.open3d": ("0.20.0", "0.21.0")}


def test_inputs_reach_into_parts():
    record = next(record for record in RECORDS if record.method_name == "mexecon")
    inputs = inputs_of(record)
    assert inputs["method.parts.1.sha256"] == "ab" * 32
    assert inputs["capture"] == record.capture.key
    assert all(isinstance(value, str) for value in inputs.values())


@pytest.mark.parametrize(
    "change",
    [
        {"protocol": ProtocolStamp("exact", 1, "ffff")},
        {"dataset": "thuman21"},
        {"recipe": "paper8"},
    ],
)
def test_other_settings_are_refused_not_compared(change):
    records = [replace(record, **change) for record in HULL]
    with pytest.raises(ProtocolMismatch, match=f"their {next(iter(change))} differs"):
        compare(records, update(HULL))
    with pytest.raises(ProtocolMismatch):
        update([HULL[0], records[1]])


def test_another_unit_is_refused_not_compared():
    with pytest.raises(ProtocolMismatch, match="another unit"):
        compare([with_chamfer(HULL[0], 1.5, unit="deg")], update(HULL[:1]))


def test_a_tolerance_in_another_unit_is_refused():
    base = update(HULL[:1])
    base = replace(base, tolerances={**base.tolerances, "chamfer": Tolerance(1.0, 0.0, "deg")})
    with pytest.raises(ProtocolMismatch, match="another unit"):
        compare(HULL[:1], base)


def test_a_metric_without_a_tolerance_is_refused():
    with pytest.raises(DataError, match="no tolerance for"):
        compare(HULL[:1], replace(update(HULL[:1]), tolerances={}))


def test_an_update_keeps_the_tolerances_of_its_predecessor():
    wide = Tolerance(5.0, 0.5, "mm")
    previous = replace(update(HULL), tolerances={"chamfer": wide})
    renewed = update([with_chamfer(HULL[0], 1.0)], previous)
    assert renewed.tolerances["chamfer"] == wide
    assert set(renewed.tolerances) == set(HULL[0].metrics)
    assert renewed.entries["hull8", "a01"].metrics["chamfer"] == Value(1.0, "mm")


def test_nothing_to_compare_is_an_error():
    with pytest.raises(HarnessError, match="Run 'harness eval' first"):
        compare([], update(HULL))
    with pytest.raises(HarnessError, match="Run 'harness eval' first"):
        update([])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('{"schema": 99, "cells": []}', "not a baseline of this version"),
        ('{"schema": 1}', "not a baseline of this version"),
        ('{"schema": 1, "cells": [{}]}', "is not a baseline"),
        ("{", "not valid JSON"),
    ],
)
def test_a_file_that_is_no_baseline_is_refused(tmp_path, text, match):
    path = tmp_path / "baseline.json"
    path.write_text(text)
    with pytest.raises(DataError, match=match):
        Baseline.load(path)


def test_markdown_keeps_its_columns_whatever_a_reason_says():
    failed = replace(HULL[0], status="failed", reason="a | b", metrics={})
    rows = [
        line
        for line in to_markdown(compare([failed], update(HULL[:1]))).splitlines()
        if line.startswith("|")
    ]
    assert rows
    assert {row.count("|") for row in rows} == {5}


def test_the_file_is_meant_to_be_read(tmp_path):
    path = tmp_path / "baseline.json"
    update(HULL[:1]).save(path)
    document = json.loads(path.read_text())
    (cell,) = document["cells"]
    assert cell["metrics"]["chamfer"] == {"value": 14.912, "unit": "mm"}
    assert cell["inputs"]["method.parameters.hull.voxel_m"] == "0.004"
    assert document["tolerances"]["chamfer"]["unit"] == "mm"
    assert "host" not in path.read_text()


def test_a_method_without_a_row_fails_unless_it_is_new_on_purpose():
    other = [replace(record, method=replace(record.method, name="fresh")) for record in HULL]
    base = update(HULL)
    comparison = compare([*HULL, *other], base)
    assert comparison.unlisted == ("fresh",)
    assert not comparison.passed
    assert "fresh" in to_text(comparison)
    assert "fresh" in to_markdown(comparison)
    listed = replace(base, new_methods={"fresh": "its numbers come with the next release"})
    assert compare([*HULL, *other], listed).passed


def test_errors_of_normal_maps_are_guarded_like_metrics():
    def with_maps(record, mean_deg):
        pixels = AngularErrors(mean_deg, mean_deg, 0.5, 0.75, 1.0, n=10)
        folds = FoldErrors(mean_deg / 3, mean_deg, 0.5)
        entry = NormalMapErrors(0, 0.0, "near", None, AngularPair(pixels, pixels), folds)
        return replace(record, normal_maps=(entry,))

    base = update([with_maps(HULL[0], 12.0)])
    assert base.entries["hull8", HULL[0].subject].metrics["normal_map_0_near"].value == 12.0
    assert compare([with_maps(HULL[0], 12.05)], base).passed
    moved = compare([with_maps(HULL[0], 13.0)], base).moved
    guarded = {"normal_map_0_near", "normal_folds_0_near"}
    assert {(cell.metric, cell.unit) for cell in moved} == {(name, "deg") for name in guarded}
    missing = {cell.metric for cell in compare([HULL[0]], base).missing}
    assert missing == guarded


def test_a_measured_spread_becomes_the_methods_own_tolerance(tmp_path):
    base = update([with_chamfer(HULL[0], 20.0)])
    made = with_spread(base, {"other-light": [with_chamfer(HULL[0], 20.4)]})
    own = made.tolerance("hull8", "chamfer")
    assert own.absolute == pytest.approx(1.2)
    assert "other-light" in own.source
    assert made.tolerance("gt", "chamfer") == base.tolerance("gt", "chamfer")
    # What hardly differs keeps the default, which is for rounding.
    assert "hull8/normal_error" not in made.tolerances
    made.save(tmp_path / "baseline.json")
    assert Baseline.load(tmp_path / "baseline.json") == made


def test_a_wider_tolerance_of_earlier_runs_stays():
    base = update([with_chamfer(HULL[0], 20.0)])
    first = with_spread(base, {"other-light": [with_chamfer(HULL[0], 20.4)]})
    later = with_spread(first, {"other-processor": [with_chamfer(HULL[0], 20.1)]})
    assert later.tolerance("hull8", "chamfer") == first.tolerance("hull8", "chamfer")
    wider = with_spread(first, {"other-processor": [with_chamfer(HULL[0], 20.5)]})
    assert wider.tolerance("hull8", "chamfer").absolute == pytest.approx(1.5)
    # Nor does a run of other methods take it away.
    others = [record for record in RECORDS if record.method_name != "hull8"]
    assert with_spread(first, {"other-light": others}).tolerances == first.tolerances


def test_a_spread_is_not_measured_with_another_recipe():
    base = update(HULL)
    with pytest.raises(ProtocolMismatch, match="run other-light .* their recipe differs") as raised:
        with_spread(base, {"other-light": [replace(record, recipe="paper8") for record in HULL]})
    assert "paper8" in str(raised.value)


def test_a_spread_is_not_measured_on_other_photos():
    base = update(HULL)
    grain = [replace(each, capture=replace(each.capture, key="other grain")) for each in HULL]
    with pytest.raises(ProtocolMismatch, match="it has other photos"):
        with_spread(base, {"other-noise": grain})


#: What the stored baseline must see: a share of the number, at least so much.
PLANTED = {"chamfer": (0.01, 0.15), "normal_error": (0.0, 0.3), "joint_error": (0.0, 1.0)}
STORED = Baseline.load(Path(__file__).parents[3] / "golden" / "baselines" / "quickstart.json")
#: Other arithmetic moves these by about as much: a smaller change of them is not told from it.
WIDE = {
    "econ": {"chamfer", "joint_error", "normal_error"},
    "jmbo8": {"joint_error", "normal_error"},
    "jmbo8+": {"chamfer"},
    "jmbo8-no-head": {"joint_error"},
    "mexecon+": {"chamfer", "normal_error"},
    "mexecon+two-sheets": {"normal_error"},
    "mexecon2": {"chamfer", "normal_error"},
    "mexecon8": {"chamfer", "joint_error", "normal_error"},
    "oracle8": {"chamfer", "joint_error", "normal_error"},
    "stereo8-psr": {"chamfer", "normal_error"},
}
GUARDED = [
    pytest.param(cell, metric, id=f"{cell.method}-{cell.subject}-{metric}")
    for cell in STORED.cells
    for metric in PLANTED
    if metric in cell.metrics and metric not in WIDE.get(cell.method, ())
]


@pytest.mark.parametrize(("cell", "metric"), GUARDED)
def test_a_small_change_of_any_method_is_found(cell, metric):
    stored = {
        name: MetricValue(each.value, each.unit, 1, 0.0) for name, each in cell.metrics.items()
    }
    share, least = PLANTED[metric]
    number = cell.metrics[metric]
    base = replace(STORED, cells=(replace(cell, metrics={metric: number}),))
    for sign in (1, -1):
        changed = number.value + sign * max(share * number.value, least)
        metrics = {**stored, metric: replace(stored[metric], value=changed)}
        record = replace(
            HULL[0],
            method=replace(HULL[0].method, name=cell.method),
            subject=cell.subject,
            dataset=base.dataset,
            recipe=base.recipe,
            metrics=metrics,
        )
        base_here = replace(base, protocol=record.protocol.to_flat())
        assert [each.metric for each in compare([record], base_here).moved] == [metric]


def test_numbers_of_a_method_that_had_none_are_not_guarded_by_its_absence():
    missing = [
        replace(each, status="missing", reason="no model", metrics={}, key="") for each in HULL
    ]
    others = [each for each in RECORDS if each.method_name != "hull8"]
    base = update([*others, *missing])
    assert compare([*others, *missing], base).passed
    comparison = compare(RECORDS, base)
    assert comparison.unlisted == ("hull8",)
    assert not comparison.passed
    assert compare(RECORDS, replace(base, new_methods={"hull8": "since today"})).passed
