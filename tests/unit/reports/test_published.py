"""The paper's numbers: complete, apart, and never compared with ours."""

from pathlib import Path

import pytest

from harness.pipeline.store import RunStore
from reports.cost import cost_table
from reports.geometry import GEOMETRY_METRICS, geometry_table
from reports.latex import to_latex
from reports.published import PUBLISHED

RECORDS = RunStore(Path(__file__).parents[2] / "golden" / "run").records()


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
    plain, shown = make(RECORDS), make(RECORDS, published=True)
    assert plain.rows == shown.rows
    assert "ECON &" not in to_latex(plain)
    below = to_latex(shown).split("Published, not measured here")[1]
    assert "ECON &" in below
    assert r"\textbf" not in below
