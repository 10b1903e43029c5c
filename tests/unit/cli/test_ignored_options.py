"""Options that would take no part in what a command makes are refused, never dropped."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.core.errors import HarnessError, MissingPart
from harness.run.store import RunStore

GOLDEN = Path(__file__).parents[2] / "golden" / "run"


def refused(*arguments: str) -> str:
    found = CliRunner().invoke(app, arguments)
    assert isinstance(found.exception, HarnessError), found.output
    return str(found.exception)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--page", "out", "--table", "cost"], "--table cannot be combined with --page"),
        (["--page", "out", "--json"], "--json cannot be combined with --page"),
        (["--page", "out", "-o", "x.md"], "--output cannot be combined with --page"),
        (["--page", "out", "--figure", "x"], "--figure cannot be combined with --page"),
        (["--figure", "x", "--interval"], "--interval cannot be combined with --figure"),
        (["--figure", "x", "--surfaces", "a"], "--surfaces cannot be combined with --figure"),
        (["--table", "photos", "--paired"], "--paired cannot be combined with --table photos"),
        (["--table", "seeds", "--interval"], "--interval cannot be combined with --table seeds"),
        (["--include-licensed"], "--include-licensed cannot be combined with a table"),
    ],
)
def test_reports(options: list[str], message: str) -> None:
    assert refused("report", *options).startswith(message)


def test_a_spread_without_an_update(tmp_path: Path) -> None:
    said = refused("check", f"{tmp_path / 'baseline.json'}", "--spread", "other")
    assert said.startswith("--spread widens the tolerances that --update writes")


def test_a_baseline_names_what_it_does_not_guard(tmp_path: Path) -> None:
    run = tmp_path / "runs" / "golden"
    shutil.copytree(GOLDEN, run)
    store = RunStore(run)
    store.begin()
    record = next(each for each in store.records() if each.method_name == "hull8")
    lost = replace(record, status="missing", reason="no model\nat all", metrics={})
    lost.save(run / "hull8" / record.subject / "record.json")
    of_run = ["--run", "golden", "--workspace", f"{tmp_path}", "--update"]
    file = f"{tmp_path / 'baseline.json'}"

    told = CliRunner().invoke(app, ["check", file, *of_run])
    as_json = CliRunner().invoke(app, ["check", file, *of_run, "--json"])

    first, *others = told.stdout.splitlines()
    assert first == f"12 records written to {file}"
    assert f"without numbers: hull8 on {record.subject} missing: no model" in others
    said = json.loads(as_json.stdout)
    assert (said["file"], said["records"]) == (file, 12)
    assert {"method": "hull8", "subject": record.subject} in said["without_numbers"]
    assert len(said["without_numbers"]) == len(others)


@pytest.mark.parametrize("value", ["", " , "])
@pytest.mark.parametrize(
    "words",
    [
        ["eval", "--method", "hull8", "--dry-run", "--subjects"],
        ["eval", "--method"],
        ["data", "make", "avatars", "--subjects"],
        ["report", "--method"],
        ["results", "records", "x.jsonl", "--subjects"],
    ],
)
def test_a_list_that_is_given_and_empty_does_not_mean_all(words: list[str], value: str) -> None:
    rest = "" if words == ["eval", "--method"] else f", or leave {words[-1]} out for all"
    assert refused(*words, value) == f"{words[-1]} names nothing. Name some{rest}"


def test_a_plan_asks_for_the_datasets_folder(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.delenv("THUMAN21_ROOT", raising=False)
    words = ["eval", "--dataset", "thuman21", "--method", "hull8", "--dry-run"]
    found = CliRunner().invoke(app, [*words, "--workspace", f"{tmp_path}"])
    assert isinstance(found.exception, MissingPart)
    assert "set THUMAN21_ROOT" in str(found.exception)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--name", "foo"], "--name is of a folder of meshes, and --gt names one"),
        (["--run", "bar"], "--run is of a folder of meshes"),
        (["--points", "x.dat"], "--points x.dat (expected a file that ends in .npz)"),
        ([], "is a folder (expected a mesh, with --gt)"),
    ],
)
def test_scores_of_a_pair(tmp_path: Path, more: list[str], said: str) -> None:
    (tmp_path / "a.ply").write_text("")
    predicted = tmp_path / "a.ply" if more else tmp_path
    assert said in refused("score", f"{predicted}", "--gt", f"{tmp_path / 'a.ply'}", *more)


def test_a_published_table_takes_no_run() -> None:
    said = refused("report", "--table", "published", "--run", "mine")
    assert said.startswith("--run cannot be combined with --table published, which needs no run")


def test_boards_and_baselines_that_are_not_there(tmp_path: Path) -> None:
    assert refused("results", "compare", f"{tmp_path}", f"{tmp_path / 'no'}").startswith(
        f"there is no board at {tmp_path / 'no'}"
    )
    run = tmp_path / "runs" / "golden"
    shutil.copytree(GOLDEN, run)
    RunStore(run).begin()
    said = refused("check", f"{tmp_path / 'no.json'}", "--workspace", f"{tmp_path}")
    assert said.endswith("Write a run's numbers there with --update")
