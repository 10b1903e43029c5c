"""The whole way on a small world, through the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from harness import HarnessError, evaluate, read_run


def records(world: Path, run: str = "main") -> dict[str, dict]:
    """Records by method/subject."""
    found = sorted((world / "runs" / run).glob("*/*/record.json"))
    return {f"{p.parent.parent.name}/{p.parent.name}": json.loads(p.read_text()) for p in found}


@pytest.mark.slow
def test_from_scans_to_tables(world, harness, eval_toy):
    run = eval_toy("coarse,gt", "--jobs", "2")
    assert run.returncode == 0, run.stderr
    assert "6 ok (0 cached)" in run.stdout
    # No terminal here: plain lines, on standard error alone.
    told = run.stderr.splitlines()
    assert told[:2] == ["photos: 0 of 24", "reconstructions: 0 of 6"]
    assert any(line.startswith("photos: 24 of 24, ") for line in told)
    assert told[-1].startswith("reconstructions: 6 of 6, ")
    again = eval_toy("coarse,gt", "--json")
    assert json.loads(again.stdout)["cached"] == 6
    assert again.stderr == ""

    table = json.loads(
        harness("report", "--table", "geometry", "--format", "json", "--interval").stdout
    )
    rows = {row["method"]: row for row in table["rows"]}
    assert set(rows) == {"coarse", "gt"}
    for row in rows.values():
        assert (row["n"], row["of"]) == (3, 3)
        for value in row["metrics"].values():
            assert value["low"] <= value["mean"] <= value["high"]
    truth = {name: value["mean"] for name, value in rows["gt"]["metrics"].items()}
    assert truth["p2s_accuracy"] == pytest.approx(0, abs=1e-3)
    assert truth["p2s_completeness"] == pytest.approx(0, abs=1e-3)
    assert truth["normal_error"] == pytest.approx(0, abs=1e-2)
    hull = {name: value["mean"] for name, value in rows["coarse"]["metrics"].items()}
    assert 1 < hull["p2s_accuracy"] < 40
    assert hull["chamfer"] > truth["chamfer"]
    (floor,) = [text for text in table["remarks"] if text.startswith("Sampling floor of Chamfer")]
    assert floor.endswith(f" {truth['chamfer']:.2f} mm")

    latex = harness("report", "--format", "latex", "--published").stdout
    assert "\\toprule" in latex
    assert "40.56" in latex
    cost = json.loads(harness("report", "--table", "cost", "--json").stdout)
    assert {row["method"] for row in cost["rows"]} == {"coarse", "gt"}
    figure = harness("report", "--figure", "qualitative", "-o", "figure.png")
    assert figure.returncode == 0, figure.stderr
    assert (world / "figure.png").stat().st_size > 10_000


@pytest.mark.nightly
@pytest.mark.usefixtures("photographed")
def test_one_method_with_two_settings_fills_two_rows(world, eval_toy, harness):
    subject = ("--subjects", "t1")
    assert eval_toy("coarse", *subject).returncode == 0
    coarser = eval_toy("coarse", *subject, "--set", "hull.voxel_m=0.08", "--as", "coarser")
    assert coarser.returncode == 0, coarser.stderr
    both = records(world)
    assert both["coarser/t1"]["method"]["title"].endswith(", hull.voxel_m=0.08")
    assert both["coarser/t1"]["key"] != both["coarse/t1"]["key"]
    table = json.loads(harness("report", "--table", "paired", "--format", "json").stdout)
    assert "coarser" in json.dumps(table)


@pytest.mark.nightly
@pytest.mark.usefixtures("photographed")
def test_a_second_run_does_nothing_and_a_change_says_why(world, eval_toy):
    first = eval_toy("gt", "--subjects", "t1")
    assert first.returncode == 0, first.stderr
    stamp = (world / "runs/main/gt/t1/record.json").stat().st_mtime_ns
    assert "(1 cached)" in eval_toy("gt", "--subjects", "t1").stdout
    assert (world / "runs/main/gt/t1/record.json").stat().st_mtime_ns == stamp

    dry = eval_toy("gt", "--subjects", "t1", "--protocol", "exact", "--seed", "1", "--dry-run")
    assert "run     changed: protocol name mexecon -> exact" in dry.stdout
    assert "seed 0 -> 1" in dry.stdout
    manifest = world / "data_manifest.yaml"
    manifest.write_text(manifest.read_text().replace("width: 108", "width: 100"))
    assert "photos stale: changed: recipe width 108 -> 100" in eval_toy("gt", "--dry-run").stdout


@pytest.mark.nightly
@pytest.mark.usefixtures("photographed")
def test_a_failed_subject_is_a_record_and_the_run_goes_on(world, eval_toy, harness):
    texture = world / "scans/model/t2/material0.jpeg"
    kept = texture.read_bytes()
    texture.unlink()
    run = eval_toy("gt")
    assert run.returncode == 1
    found = records(world)
    assert [found[f"gt/{s}"]["status"] for s in ("t1", "t2", "t3")] == ["ok", "failed", "ok"]
    assert "texture" in found["gt/t2"]["reason"]
    assert "material0.jpeg" in found["gt/t2"]["reason"]
    # Records are passed on: they do not say where the workspace is.
    assert "scans/model/t2" in found["gt/t2"]["reason"]
    assert str(world) not in found["gt/t2"]["reason"]
    table = harness("report", "--table", "geometry").stdout
    assert "2/3" in table

    texture.write_bytes(kept)
    again = eval_toy("gt")
    assert again.returncode == 0, again.stderr
    assert "(2 cached)" in again.stdout


@pytest.mark.nightly
@pytest.mark.usefixtures("photographed")
def test_settings_are_part_of_the_key(world, eval_toy):
    assert eval_toy("hull8", "--subjects", "t1", "--set", "hull.voxel_m=0.02").returncode == 0
    coarse = records(world)["hull8/t1"]
    assert coarse["method"]["parameters"]["hull"]["voxel_m"] == 0.02
    assert eval_toy("hull8", "--subjects", "t1", "--set", "hull.voxel_m=0.03").returncode == 0
    assert records(world)["hull8/t1"]["key"] != coarse["key"]
    wrong = eval_toy("hull8", "--set", "hull.voxel=1")
    assert wrong.returncode == 2
    assert "Did you mean 'hull.voxel_m'?" in wrong.stderr


@pytest.mark.nightly
@pytest.mark.usefixtures("measured")
def test_meshes_made_elsewhere(world, harness, eval_toy):
    assert eval_toy("gt", "--subjects", "t1,t2").returncode == 0
    folder = world / "mine"
    folder.mkdir()
    for subject in ("t1", "t2"):
        (folder / f"{subject}.ply").write_bytes(
            (world / f"runs/main/gt/{subject}/mesh.ply").read_bytes()
        )
    run = harness("score", "mine", "--dataset", "toy", "--name", "elsewhere", "--run", "other")
    assert run.returncode == 1, "a subject without a mesh is missing, which the exit code says"
    found = records(world, "other")
    assert found["elsewhere/t3"]["status"] == "missing"
    assert found["elsewhere/t1"]["metrics"]["p2s_accuracy"]["value"] == pytest.approx(0, abs=1e-3)
    assert "2/3" in harness("report", "--run", "other").stdout
    assert "run here" in harness("score", "mine", "--dataset", "toy", "--name", "gt").stderr


def test_score_of_a_pair_prints_json(world, harness):
    scan = "scans/model/t1/t1.obj"
    run = harness("score", scan, "--gt", scan, "--protocol", "exact", "--json", "--points", "p.npz")
    document = json.loads(run.stdout)
    assert set(document["metrics"]) == {
        "chamfer", "p2s_accuracy", "p2s_completeness", "normal_error",
    }  # fmt: skip
    assert document["metrics"]["chamfer"]["unit"] == "mm"
    assert document["metrics"]["normal_error"]["unit"] == "deg"
    assert document["metrics"]["chamfer"]["value"] == pytest.approx(0, abs=1e-3)
    assert (world / "p.npz").is_file()


@pytest.mark.usefixtures("measured")
def test_a_run_from_python_is_that_of_the_command(world):
    """What the command filed is current for ``evaluate``; another protocol is measured anew."""
    place = {"workspace": str(world), "manifest": world / "data_manifest.yaml"}
    before = records(world)

    kept = evaluate("gt", "toy", ["t1", "t2"], "tiny", **place)
    assert list(kept.status) == ["ok", "ok"]
    assert records(world) == before
    assert read_run(world / "runs" / "main").iloc[:2].equals(kept)
    assert list(evaluate("gt", "toy", "t1", "tiny", "exact", "other", **place).protocol) == [
        "exact"
    ]
    assert set(records(world, "other")) == {"gt/t1"}
    with pytest.raises(HarnessError, match=r"unknown protocol 'exakt'\. Did you mean 'exact'"):
        evaluate("gt", "toy", "t1", "tiny", "exakt", **place)


@pytest.mark.usefixtures("photographed")
def test_check_finds_what_moved(world, harness, eval_toy):
    assert eval_toy("gt,coarse", "--subjects", "t1").returncode == 0
    assert harness("check", "baseline.json", "--update").returncode == 0
    same = harness("check", "baseline.json")
    assert same.returncode == 0, same.stdout
    assert eval_toy("coarse", "--subjects", "t1", "--set", "hull.voxel_m=0.03").returncode == 0
    moved = harness("check", "baseline.json", "--summary", "summary.md")
    assert moved.returncode == 1
    assert "coarse" in moved.stdout
    assert "voxel_m" in moved.stdout
    assert "coarse" in (world / "summary.md").read_text()


def test_data_commands(world, harness):
    listing = json.loads(harness("data", "list", "--json").stdout)
    assert set(listing) == {"datasets", "splits", "addable", "recipes", "protocols"}
    assert harness("data", "check", "toy").returncode == 0
    (world / "scans/model/t3/t3.obj").unlink()
    broken = harness("data", "check", "toy")
    assert broken.returncode == 1
    assert "MISSING  model/t3/t3.obj" in broken.stdout
    assert "not generated" in harness("data", "make", "toy").stderr
