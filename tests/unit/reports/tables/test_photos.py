"""Tables of figures without a scan: means, remarks, and rank correlations that are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.photo_scores import Likeness, MapAgreement, PhotoScores, Soundness, ViewScore
from harness.core.records import AngularErrors
from harness.report.tables import FORMATS
from harness.run.store import RunStore
from reports.formats.programs import to_json
from reports.tables.photos import photo_errors_table, photos_table, rank_correlation

RUN = Path(__file__).parents[3] / "golden" / "run"
GOLDEN = [r for r in RunStore(RUN).records() if r.method_name == "hull8" and r.status == "ok"]


#: Chamfer of five methods on five subjects: a method's letter adds a little, a subject much.
RISING = {name: {f"s{k}": 10.0 * k + step for k in range(5)} for step, name in enumerate("abcde")}


def scores(iou: float, db: float = 30.0, crossing: int = 0, maps=()) -> PhotoScores:
    """Two views, of which the second has 0.1 less overlap and was not left out."""
    looks = Likeness(db, db / 40, 100)
    views = (ViewScore(0, iou, looks, replace(looks, psnr_db=db - 4)),
             ViewScore(1, iou - 0.1, replace(looks, psnr_db=db + 2), None))  # fmt: skip
    return PhotoScores(views, Soundness(1000, 0, crossing), maps, 0.9)


def made(errors: dict[str, dict[str, float]]):
    """Records by method and subject with the given Chamfer; the normal error goes the other way."""
    template = GOLDEN[0]
    chamfer, normal = (template.metrics[name] for name in ("chamfer", "normal_error"))
    return [
        replace(
            template,
            method=replace(template.method, name=method, title=method.upper()),
            subject=subject,
            capture=replace(template.capture, key=subject),
            metrics={
                "chamfer": replace(chamfer, value=value),
                "normal_error": replace(normal, value=-value),
            },
        )
        for method, by_subject in errors.items()
        for subject, value in by_subject.items()
    ]


def cells(table) -> dict[str, dict[str, float | None]]:
    rows = json.loads(to_json(table))["rows"]
    return {
        row["method"]: {name: cell["mean"] for name, cell in row["metrics"].items()} for row in rows
    }


def test_the_table_has_means_over_views_and_subjects():
    records = made({"one": {"s1": 1.0, "s2": 2.0}, "two": {"s1": 3.0, "s2": 4.0}})
    pixels = AngularErrors(8.0, 7.0, 0.9, 0.9, 0.9, 10)
    found = {
        ("one", "s1"): scores(0.9, 30.0, crossing=4, maps=(MapAgreement(0, pixels),)),
        ("one", "s2"): scores(0.7, 20.0),
    }
    why = {("two", "s1"): "its photos are gone", ("two", "s2"): "its photos are gone"}
    table = photos_table(records, found, why)
    row = cells(table)["one"]
    assert row["mean_iou"] == pytest.approx(0.75)
    assert row["worst_iou"] == pytest.approx(0.7)
    assert row["psnr"] == pytest.approx(26.0)
    assert row["held_out_psnr"] == pytest.approx(21.0)
    assert row["self_intersections"] == pytest.approx(2.0)
    assert row["watertight"] == 1.0
    assert row["normal_agreement"] == pytest.approx(8.0)
    assert "two" not in cells(table)
    assert "Without figures, because its photos are gone: two on s1, two on s2" in table.caption
    for write, _ in FORMATS.values():
        text = write(table)
        assert "ONE" in text
        assert "Lower is better" not in text


def test_what_looks_better_and_is_better_correlates_with_one():
    errors = {
        name: {f"s{k}": 10.0 * k + step for k in range(5)} for step, name in enumerate("abcde")
    }
    records = made(errors)
    found = {
        (r.method_name, r.subject): scores(1.0 - 0.005 * r.metrics["chamfer"].value, crossing=1)
        for r in records
    }
    rows = cells(photo_errors_table(records, found, {}))
    assert set(rows) == {"mean_iou", "worst_iou"}  # all others are equal everywhere
    assert {round(value, 9) for name, value in rows["mean_iou"].items() if "chamfer" in name} == {1}
    assert {round(value, 9) for name, value in rows["mean_iou"].items() if "normal" in name} == {-1}


def test_the_three_questions_have_their_own_answers():
    """Within a subject the figure goes with the error, from subject to subject against it."""
    errors = {
        name: {f"s{k}": 10.0 * k + step for k in range(5)} for step, name in enumerate("abcde")
    }
    records = made(errors)
    found = {
        (r.method_name, r.subject): scores(
            0.5 - 0.01 * "abcde".index(r.method_name) + 0.1 * int(r.subject[1])
        )
        for r in records
    }
    row = cells(photo_errors_table(records, found, {}))["mean_iou"]
    assert row["chamfer_methods"] == pytest.approx(1.0)
    assert row["chamfer_subjects"] == pytest.approx(-1.0)
    assert row["chamfer_all"] is not None
    assert row["chamfer_all"] < 0


def test_fewer_crossing_faces_count_as_better():
    records = made({"a": {f"s{k}": float(k) for k in range(6)}})
    found = {
        (r.method_name, r.subject): scores(0.9, crossing=int(r.metrics["chamfer"].value))
        for r in records
    }
    assert cells(photo_errors_table(records, found, {}))["self_intersections"][
        "chamfer_all"
    ] == pytest.approx(1.0)


def test_the_rank_correlation_is_that_of_another_implementation():
    from scipy.stats import spearmanr

    rng = np.random.default_rng(5)
    first = rng.integers(0, 6, 30).astype(float)
    second = first + rng.standard_normal(30)
    assert rank_correlation(first, second) == pytest.approx(spearmanr(first, second).statistic)
    assert rank_correlation(first[:3], second[:3]) is None
    assert rank_correlation(np.ones(9), second[:9]) is None


def test_means_over_fewer_subjects_say_so():
    records = made({"one": {"s1": 1.0, "s2": 2.0}, "two": {"s1": 3.0, "s2": 4.0}})
    found = {("one", "s1"): scores(0.9), ("two", "s1"): scores(0.8), ("two", "s2"): scores(0.7)}
    table = photos_table(records, found, {("one", "s2"): "its photos were made anew since"})
    assert [(row.n, row.of) for row in table.rows] == [(1, 2), (2, 2)]
    assert "| n/N |" in FORMATS["markdown"][0](table)
