"""What a reconstruction took: times are added up and averaged, peaks are the highest."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.core.artifacts import StageCost
from harness.core.records import Environment
from harness.run.store import RunStore
from reports.tables.cost import cost_table

RECORDS = RunStore(Path(__file__).parents[3] / "golden" / "run").records()
HULL = [record for record in RECORDS if record.method_name == "hull8"]


def costing(record, *stages):
    return replace(record, stages=stages)


def test_times_are_added_over_stages_and_averaged_over_subjects():
    table = cost_table(
        [
            costing(HULL[0], StageCost("carve", 3.0, 500.0), StageCost("contour", 1.0, 700.0)),
            costing(HULL[1], StageCost("carve", 5.0, 900.0), StageCost("contour", 1.0, 600.0)),
        ]
    )
    row = table.rows[0]
    assert row.cells["wall_s"].value == 5.0
    assert row.cells["peak_rss_mib"].value == 900.0
    carve, contour = row.stages
    assert (carve.name, carve.cells["wall_s"].value) == ("carve", 4.0)
    assert (contour.name, contour.cells["peak_rss_mib"].value) == ("contour", 700.0)


def test_a_skipped_stage_took_no_time():
    table = cost_table(
        [
            costing(HULL[0], StageCost("carve", 3.0, 500.0)),
            costing(HULL[1], StageCost("carve", 3.0, 500.0), StageCost("repair", 2.0, 500.0)),
        ]
    )
    carve, repair = table.rows[0].stages
    assert repair.cells["wall_s"].value == 1.0
    assert table.rows[0].cells["wall_s"].value == pytest.approx(
        carve.cells["wall_s"].value + repair.cells["wall_s"].value
    )


def test_gpu_memory_is_shown_only_where_it_was_measured():
    table = cost_table(
        [costing(HULL[0], StageCost("a", 1.0, 500.0), StageCost("b", 1.0, 500.0, 2048.0))]
    )
    row = table.rows[0]
    assert row.cells["peak_gpu_mib"].value == 2048.0
    assert "peak_gpu_mib" not in row.stages[0].cells
    assert "peak_gpu_mib" not in cost_table(HULL).rows[0].cells


def test_costs_are_not_ranked():
    table = cost_table(RECORDS)
    assert not any(table.is_best(row, column) for row in table.rows for column in table.columns)


def test_times_of_different_machines_are_marked():
    assert "Machine: Linux, 2 CPUs" in cost_table(HULL).remarks
    elsewhere = replace(HULL[0], environment=Environment(system="Linux", cpus=64))
    assert any("different machines" in text for text in cost_table([elsewhere, *HULL[1:]]).remarks)


def test_a_row_that_took_work_over_says_so():
    taker = replace(HULL[0], shared_work=("body fit", "landmarks"))
    remarks = " ".join(cost_table([taker, HULL[1]]).remarks)
    assert "body fit, landmarks): hull8" in remarks
    assert "--no-share" in remarks
    assert "Taken over" not in " ".join(cost_table(HULL).remarks)
