"""A run's records as a frame: every record a row, every number where it belongs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.run.store import RunStore
from reports.tables.geometry import geometry_table
from reports.tables.selection import frame

RECORDS = RunStore(Path(__file__).parents[3] / "golden" / "run").records()


def test_every_record_is_a_row_and_failed_ones_have_no_numbers():
    made = frame(RECORDS)
    assert len(made) == len(RECORDS)
    failed = made[made.status != "ok"]
    assert not failed.empty
    assert failed.chamfer.isna().all()
    assert (failed.reason != "").all()
    assert made[made.status == "ok"].chamfer.notna().all()
    assert made.chamfer.dtype == np.float64


def test_its_means_are_the_tables():
    means = frame(RECORDS).groupby("method").chamfer.mean()
    for row in geometry_table(RECORDS).rows:
        if "chamfer" in row.cells:
            assert means[row.method] == pytest.approx(row.cells["chamfer"].value)


def test_units_go_along_and_nothing_makes_an_empty_frame():
    units = frame(RECORDS).attrs["units"]
    assert (units["chamfer"], units["normal_error"], units["wall_s"]) == ("mm", "deg", "s")
    assert frame([]).empty


def test_rows_in_scan_units_can_be_told_from_those_in_metres():
    own = [replace(record, scale_rule="units") for record in RECORDS]
    made = frame([*RECORDS, *own])
    assert (made.scale_rule == "units").sum() == len(RECORDS)
