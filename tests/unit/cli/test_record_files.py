"""Tables of a file of records equal those of the run that it was written from."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.core.errors import HarnessError
from harness.run.store import RunStore

GOLDEN = Path(__file__).parents[2] / "golden" / "run"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A workspace whose run ``golden`` is the golden one, and ``run.jsonl`` with its records."""
    shutil.copytree(GOLDEN, tmp_path / "runs" / "golden")
    RunStore(tmp_path / "runs" / "golden").begin()
    arguments = ["records", f"{tmp_path / 'run.jsonl'}", "--run", "golden"]
    found = CliRunner().invoke(app, ["results", *arguments, "--workspace", f"{tmp_path}"])
    assert found.exit_code == 0, found.output
    assert found.stdout.endswith("12 records\n")
    return tmp_path


def report(*arguments: str) -> str:
    found = CliRunner().invoke(app, ["report", *arguments])
    assert found.exit_code == 0, found.output
    return found.stdout


@pytest.mark.parametrize("table", ["geometry", "paired", "cost", "jmbo"])
@pytest.mark.parametrize("form", ["markdown", "latex", "json"])
def test_tables_are_those_of_the_run(place: Path, table: str, form: str) -> None:
    options = ["--table", table, "--format", form, "--interval"]
    of_run = report(*options, "--run", "golden", "--workspace", f"{place}")

    assert report(*options, "--records", f"{place / 'run.jsonl'}") == of_run


def test_methods_and_subjects_are_chosen(place: Path) -> None:
    chosen = ["--method", "hull8", "--subjects", "a01,a02"]
    file = place / "few.jsonl"
    found = CliRunner().invoke(
        app,
        ["results", "records", f"{file}", "--run", "golden", "--workspace", f"{place}", *chosen],
    )
    assert found.stdout.endswith("2 records\n"), found.output
    assert report("--records", f"{file}") == report("--records", f"{place / 'run.jsonl'}", *chosen)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--run", "golden"], "--run"),
        (["--figure", "overlay"], "--figure"),
        (["--page", "out"], "--page"),
        (["--table", "photos"], "--table photos"),
        (["--table", "published"], "--table published"),
    ],
)
def test_what_needs_a_run_is_refused(place: Path, options: list[str], named: str) -> None:
    found = CliRunner().invoke(app, ["report", "--records", f"{place / 'run.jsonl'}", *options])

    assert isinstance(found.exception, HarnessError)
    assert str(found.exception).startswith(f"--records cannot be combined with {named}")


def test_a_run_is_compared_with_itself_before(place: Path) -> None:
    file = f"{place / 'run.jsonl'}"
    of_run = ["--run", "golden", "--workspace", f"{place}"]
    options = ["--table", "paired", "--before", file, "--interval"]
    found = report(*options, *of_run)

    assert found == report(*options, "--records", file)
    assert found.startswith("Difference from the same method before on ")
    assert "| Visual hull, 8 views" in found


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--table", "geometry"], "--before compares records in the paired table"),
        (["--table", "photos"], "--before compares records in the paired table"),
        (["--table", "paired", "--paired"], "--paired shows differences of the published results"),
        (["--table", "paired", "--figure", "overlay"], "--before cannot be combined with --figure"),
        (["--table", "paired", "--page", "out"], "--before cannot be combined with --page"),
    ],
)
def test_what_before_cannot_give_is_refused(place: Path, options: list[str], message: str) -> None:
    before = ["--before", f"{place / 'run.jsonl'}", "--run", "golden", "--workspace", f"{place}"]
    found = CliRunner().invoke(app, ["report", *before, *options])

    assert isinstance(found.exception, HarnessError)
    assert str(found.exception).startswith(message)
