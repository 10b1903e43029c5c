"""The body table: which methods it has, and that losses and millimetres keep their units."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from harness.core.errors import ProtocolMismatch
from harness.core.protocols import Part
from harness.core.records import MetricValue
from harness.run.store import RunStore
from reports.formats.latex import to_markdown
from reports.formats.programs import to_json
from reports.tables.jmbo import BODY_METRICS, jmbo_table

RUN = Path(__file__).parents[3] / "golden" / "run"
RECORDS = [r for r in RunStore(RUN).records() if r.method_name in ("hull8", "gt")]
UNITS = {"joint_error": "mm", "vertex_error": "mm", "silhouette_iou": "ratio"}


def with_body(record, scale=1.0, without=(), model="Anny 0.6.2"):
    """A hull's record as if it had fitted a body: metric i is ``scale * (i + 1)``."""
    added = {
        name: MetricValue(scale * (index + 1), UNITS.get(name, "1"), 8, 0.0)
        for index, name in enumerate(BODY_METRICS)
        if name not in without
    }
    method = replace(record.method, parts=(Part("body model", model, "as it says"),))
    return replace(record, method=method, metrics={**record.metrics, **added})


def bodies(**kwargs):
    return [with_body(r, **kwargs) if r.method_name == "hull8" else r for r in RECORDS]


def test_only_methods_with_a_body_have_a_row_and_the_others_are_named():
    table = jmbo_table(bodies())
    assert [row.method for row in table.rows] == ["hull8"]
    assert "Without a fitted body: Ground truth" in table.caption


def test_cells_are_means_in_the_metrics_own_units():
    document = json.loads(to_json(jmbo_table(bodies(scale=2.0))))
    assert list(document["columns"]) == list(BODY_METRICS)
    assert document["columns"]["total_loss"]["unit"] == "1"
    assert document["columns"]["joint_error"]["unit"] == "mm"
    metrics = document["rows"][0]["metrics"]
    assert metrics["silhouette_loss"]["mean"] == 2.0
    assert metrics["silhouette_iou"]["mean"] == 14.0


def test_more_overlap_is_never_marked_as_worse():
    document = json.loads(to_json(jmbo_table(bodies())))
    assert "silhouette_iou" not in document["rows"][0]["best"]
    assert "total_loss" in document["rows"][0]["best"]


def test_it_says_that_the_fitted_body_is_of_the_family_of_the_true_ones():
    assert "of the family that generated the subjects (Anny)" in jmbo_table(bodies()).caption
    assert "manifold" not in jmbo_table(bodies()).caption
    fitted = jmbo_table(bodies(model="SMPL-X")).caption
    assert "The true bodies are SMPL-X fits of the scans, of the model that is fitted" in fitted
    assert "Anny" not in fitted


def test_it_says_how_far_true_bodies_are_off_the_models_manifold():
    fitted = [r for r in bodies() if r.method_name == "hull8"]
    moved = [
        replace(r, metrics={**r.metrics, "off_model": MetricValue(4.0 + k, "mm", 9, 0.0)})
        for k, r in enumerate(fitted)
    ]
    caption = jmbo_table(moved).caption
    assert f"{len(moved)} true bodies are off the model's manifold" in caption
    assert f"4.0 to {3.0 + len(moved):.1f} mm" in caption


def test_a_dataset_without_true_bodies_shows_dashes():
    table = jmbo_table(bodies(without=("joint_error", "vertex_error")))
    assert "generated the subjects" not in table.caption
    assert "joint_error" not in table.rows[0].cells
    assert "–" in to_markdown(table)


def test_a_metric_that_only_some_subjects_have_is_refused():
    records = bodies()
    index = next(i for i, r in enumerate(records) if r.method_name == "hull8")
    records[index] = with_body(
        next(r for r in RECORDS if r.method_name == "hull8"), without=("normal_loss",)
    )
    with pytest.raises(ProtocolMismatch, match="has no normal_loss"):
        jmbo_table(records)


def test_a_pure_number_has_no_unit_in_its_heading():
    header = to_markdown(jmbo_table(bodies())).splitlines()
    text = next(line for line in header if line.startswith("| Method"))
    assert "Total loss ↓" in text
    assert "Joint error (mm) ↓" in text
