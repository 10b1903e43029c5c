"""The region table: pooled columns, who is in the mean, and what stands in which format."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import pytest

from clothed_avatars.clothes import wardrobe
from clothed_avatars.skin.bake import _REGIONS
from harness.core.records import RegionErrors
from harness.run.store import RunStore
from reports.formats.latex import to_latex, to_markdown
from reports.formats.programs import to_csv, to_json
from reports.tables.regions import REGION_GROUPS, regions_table
from reports.tables.selection import Asked

RUN = Path(__file__).parents[3] / "golden" / "run"
RECORDS = [r for r in RunStore(RUN).records() if r.method_name in ("hull8", "gt")]
SUBJECTS = [r.subject for r in RECORDS if r.method_name == "hull8" and r.status == "ok"]


def errors(completeness, share=0.1, n=100, **more):
    found = RegionErrors(
        area_share=share,
        accuracy_mm=completeness / 2,
        completeness_mm=completeness,
        normal_error_deg=9.0,
        missing_share=0.25,
        bulge_share=0.125,
        n_predicted=n,
        n_truth=n,
    )
    return replace(found, **more)


def with_regions(regions, method="hull8"):
    """The golden records of two methods, those of one with errors by region."""
    return [
        replace(r, regions=regions(r.subject))
        if r.method_name == method and r.status == "ok"
        else r
        for r in RECORDS
    ]


def rows(table):
    return {row["method"]: row for row in json.loads(to_json(table))["rows"]}


def test_regions_of_a_column_are_pooled_by_their_points():
    table = regions_table(
        with_regions(lambda _: {"feet": errors(10.0, n=100), "shoes": errors(40.0, n=300)})
    )
    cells = rows(table)["hull8"]["metrics"]
    assert cells["completeness_feet"]["mean"] == pytest.approx((10 * 100 + 40 * 300) / 400)
    assert cells["area_feet"]["mean"] == pytest.approx(0.2)
    assert cells["missing_feet"]["mean"] == pytest.approx(0.25)
    assert cells["completeness_arms"]["mean"] is None


def test_a_subject_counts_where_it_has_the_region():
    """Not where it has none, and not where it is a few points at the edge of something else."""
    first, second = SUBJECTS[:2]
    regions = {
        first: {"arms": errors(10.0), "hair": errors(5.0)},
        second: {"arms": errors(900.0, share=0.001), "hair": errors(7.0)},
    }
    records = with_regions(lambda subject: regions.get(subject, {"hair": errors(6.0)}))
    table = regions_table(records, Asked(methods=["hull8"]))
    cells = rows(table)["hull8"]["metrics"]
    assert cells["completeness_arms"]["mean"] == pytest.approx(10.0)
    n = len([r for r in records if r.regions])
    assert f"Not on all of {n} subjects: Head 0, Torso 0, Arms 1" in table.caption


def test_each_column_has_its_best_on_the_subjects_that_all_rows_have_there():
    first, second, third = SUBJECTS
    hull = with_regions(
        lambda s: {"hair": errors(10.0 if s == first else 90.0), "hands": errors(10.0)}
    )
    hull = [record for record in hull if record.method_name == "hull8"]
    other = {
        first: {"hair": errors(20.0)},
        second: {"hands": errors(20.0)},
        third: {"hands": errors(5.0)},
    }
    named = [
        replace(
            record,
            method=replace(record.method, name="other", title="Other"),
            regions=other[record.subject],
        )
        for record in hull
    ]
    table = regions_table([*hull, *named])
    found = rows(table)
    assert found["hull8"]["best"] == ["completeness_hair", "completeness_hands"]
    assert found["hull8"]["metrics"]["completeness_hair"]["mean"] > 60
    assert found["other"]["best"] == []
    ranked_on = json.loads(to_json(table))["ranked_on"]
    assert ranked_on["completeness_hair"] == [first]
    assert ranked_on["completeness_hands"] == [second, third]
    assert "bold by the means on the subjects that all ranked rows with numbers" in table.caption
    (note,) = [text for text in found["hull8"]["notes"] if "On the" in text]
    assert note.endswith("have: Hair 10.0 mm, Hands 10.0 mm")


def test_a_region_that_no_predicted_point_is_near_has_no_accuracy():
    none = dict.fromkeys(("accuracy_mm", "normal_error_deg", "bulge_share"))
    lost = {"hands": errors(300.0, **none, n_predicted=0), "head": errors(4.0)}
    cells = rows(regions_table(with_regions(lambda _: lost)))["hull8"]["metrics"]
    assert cells["completeness_hands"]["mean"] == 300.0
    assert cells["accuracy_hands"]["mean"] is None
    assert cells["accuracy_head"]["mean"] == 2.0


def test_methods_without_regions_are_named_and_alone_they_leave_no_row():
    table = regions_table(with_regions(lambda _: {"head": errors(3.0)}))
    assert [row.method for row in table.rows] == ["hull8"]
    assert "Without errors by region" in table.caption
    assert "Ground truth" in table.caption
    assert regions_table(RECORDS).rows == ()


def test_one_record_that_tells_nothing_takes_its_method_out_and_says_so():
    records = with_regions(lambda subject: {} if subject == SUBJECTS[0] else {"head": errors(3.0)})
    table = regions_table(records)
    told = sum(r.method_name == "hull8" and r.status == "ok" for r in records)
    assert table.rows == ()
    assert f"Visual hull, 8 views (1 of {told} records)" in table.caption


def test_print_has_completeness_and_files_have_everything():
    table = regions_table(with_regions(lambda _: {"head": errors(3.0), "sleeve": errors(9.0)}))
    header = next(line for line in to_markdown(table).splitlines() if line.startswith("| Method"))
    assert header.count("(mm) ↓") == len(REGION_GROUPS) == 8
    assert "normal error" not in to_latex(table)
    document = json.loads(to_json(table))
    assert len(document["columns"]) == 6 * len(REGION_GROUPS)
    assert document["columns"]["normal_error_head"]["unit"] == "deg"
    assert document["rows"][0]["best"] == ["completeness_head"]
    [line] = csv.DictReader(io.StringIO(to_csv(table)))
    assert float(line["completeness_head_mean_mm"]) == 3.0
    assert float(line["missing_head_mean_ratio"]) == 0.25
    assert "In no column: sleeve" in table.caption


def test_every_label_of_the_avatars_is_in_exactly_one_column():
    """Also of garments that are not in the wardrobe yet: it is read, not listed here."""
    fabric = wardrobe.Fabric((90, 90, 90))
    makers = [
        each
        for name, each in vars(wardrobe).items()
        if name[0].islower() and getattr(each, "__module__", "") == wardrobe.__name__
    ]
    # A jacket is worn over a shirt.
    garments = [maker(*[fabric] * (2 if maker is wardrobe.jacket else 1)).kind for maker in makers]
    assert len(garments) > 8
    for label in ("eyes", "hair", "shoes", "shirt", *garments, *(name for name, _ in _REGIONS)):
        assert sum(label in group.regions for group in REGION_GROUPS) == 1, label
