"""Sealed data: no look without a reason, and a line in the log for each."""

import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from harness.core.errors import HarnessError
from harness.core.records import Environment
from harness.data.manifest import load_manifest
from harness.run import captures, sealed
from harness.run import record_inputs as environment
from harness.run.captures import make_avatars, render_all, show_avatar
from harness.run.evaluate import evaluate
from harness.run.method_choice import chosen_methods
from harness.run.plan import EvalRequest
from harness.run.progress import Silent
from harness.run.sealed import Look, admit, log_path
from harness.run.sources import Source
from harness.run.store import RunStore
from harness.run.workspace import Workspace

SHIPPED = Path(__file__).resolve().parents[3] / "data_manifest.yaml"
SEALED = "avatars-sealed"


class Heard(Silent):
    """Keeps what is said."""

    def __init__(self):
        self.lines = []

    def say(self, text):
        self.lines.append(text)


@pytest.fixture
def manifest():
    return load_manifest(SHIPPED)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A workspace of a program that was installed without a checkout."""
    monkeypatch.setattr(sealed, "checkout", lambda: None)
    return Workspace(tmp_path)


def source_of(manifest, place, dataset=SEALED, subjects=("s01", "s02")):
    return Source.select(manifest, place, dataset, subjects, "quick8")


def look(reason, **kwargs):
    values = {"what": "evaluation", "dataset": SEALED, "subjects": ("s01",), **kwargs}
    return Look(reason=reason, **values)


def rows(place):
    path = place.root / "sealed.md"
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    return [line for line in text.splitlines() if line.startswith("| 2")]


def test_the_manifest_seals_one_dataset_by_a_field(manifest):
    assert [name for name, entry in manifest.datasets.items() if entry.sealed] == [SEALED]
    assert manifest.datasets[SEALED].subjects == tuple(f"s{k:02d}" for k in range(1, 21))


@pytest.mark.parametrize("reason", ["", "  \n"])
def test_no_look_without_a_reason(manifest, place, reason):
    with pytest.raises(HarnessError, match=r"is sealed.*--reason") as caught:
        admit(manifest, place, look(reason), Silent())
    assert caught.value.exit_code == 2
    assert not rows(place)


def test_open_data_need_no_reason_and_are_not_logged(manifest, place):
    assert admit(manifest, place, look("", dataset="avatars", subjects=("a01",)), Silent()) is None
    assert not rows(place)


def test_a_look_is_announced_and_logged_in_one_line(manifest, place, monkeypatch):
    made = Environment(harness="1.0", commit="0123456789abcdef", dirty=True)
    monkeypatch.setattr(sealed, "environment", lambda: made)
    heard = Heard()
    asked = look("last\ntest | of all", methods=("jmbo8", "hull8"), recipe="paper8")
    admit(manifest, place, asked, heard)
    assert any("is sealed" in line for line in heard.lines)
    (row,) = rows(place)
    cells = [cell.strip() for cell in row.strip("| ").split("|")]
    assert cells[0].endswith("+00:00")
    assert cells[1:] == [
        "0123456789ab (dirty)",
        "evaluation",
        "last test / of all",
        "jmbo8, hull8",
        "paper8",
        "avatars-sealed: s01",
    ]


def test_looks_at_the_same_time_are_all_logged(manifest, place):
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda k: admit(manifest, place, look(f"no {k}"), Silent()), range(24)))
    assert sorted(row.split(" | ")[3] for row in rows(place)) == sorted(
        f"no {k}" for k in range(24)
    )
    header = (place.root / "sealed.md").read_text(encoding="utf-8")
    assert header.count("| Date (UTC) |") == 1


def test_a_checkout_logs_in_its_documents_and_stays_clean_for_it(tmp_path, monkeypatch):
    folder = tmp_path / "checkout"
    (folder / "docs" / "lab").mkdir(parents=True)
    (folder / "docs" / "lab" / "sealed.md").write_text("log\n")
    git = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b.c"]
    for command in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "first"]):
        subprocess.run([*git, *command], check=True, capture_output=True)
    monkeypatch.setattr(environment, "checkout", lambda: folder)
    monkeypatch.setattr(sealed, "checkout", lambda: folder)
    assert log_path(Workspace(tmp_path)) == folder / "docs" / "lab" / "sealed.md"
    (folder / "docs" / "lab" / "sealed.md").write_text("log\none more line\n")
    assert environment._commit().dirty is False
    (folder / "other.py").write_text("x = 1\n")
    assert environment._commit().dirty is True


def test_the_documents_end_with_the_table_that_lines_are_added_to():
    text = (SHIPPED.parent / "docs" / "lab" / "sealed.md").read_text(encoding="utf-8")
    head = [line for line in sealed._HEAD.splitlines() if line.startswith("|")]
    assert "\n".join(head) in text
    after = text.split(head[-1])[1].strip().splitlines()
    assert all(line.count("|") == len(sealed._COLUMNS) + 1 for line in after)


def request_of(manifest, place, reason):
    return EvalRequest(
        source=source_of(manifest, place),
        methods=chosen_methods(("hull8",), {}),
        protocol=manifest.protocol("mexecon"),
        store=RunStore(place.run("main")),
        reason=reason,
    )


def test_an_evaluation_without_a_reason_does_nothing(manifest, place):
    with pytest.raises(HarnessError, match="this evaluation has no reason"):
        evaluate(request_of(manifest, place, ""), Silent())
    assert not place.runs.exists()
    assert not (place.root / "data").exists()


def test_an_evaluation_is_logged_before_it_begins(manifest, place, monkeypatch):
    def broken(*_args):
        raise KeyboardInterrupt

    monkeypatch.setattr("harness.run.evaluate.plan", broken)
    with pytest.raises(KeyboardInterrupt):
        evaluate(request_of(manifest, place, "the last test"), Silent())
    (row,) = rows(place)
    assert "| evaluation | the last test | hull8 | quick8 | avatars-sealed: s01, s02 |" in row


def test_a_contact_sheet_needs_a_reason_and_is_logged(manifest, place, tmp_path, monkeypatch):
    source = source_of(manifest, place)
    with pytest.raises(HarnessError, match="this contact sheet has no reason"):
        show_avatar(source, tmp_path / "s01.png", Silent())
    assert not (tmp_path / "data").exists()

    def broken(*_args):
        raise HarnessError("stopped after the log")

    monkeypatch.setattr(captures, "make_avatars", broken)
    with pytest.raises(HarnessError, match="stopped after the log"):
        show_avatar(source, tmp_path / "s01.png", Silent(), "does the generator work")
    (row,) = rows(place)
    assert "| contact sheet | does the generator work | – | – | avatars-sealed: s01 |" in row


def test_making_and_rendering_is_announced_and_not_logged(manifest, place, monkeypatch):
    def broken(*_args, **_kwargs):
        raise HarnessError("no worker in this test")

    monkeypatch.setattr(captures, "run_worker", broken)
    for work in (make_avatars, render_all):
        heard = Heard()
        work(source_of(manifest, place), 1, heard)
        assert any("is sealed" in line for line in heard.lines)
        heard = Heard()
        work(source_of(manifest, place, "avatars", ("a01",)), 1, heard)
        assert not heard.lines
    assert not rows(place)


def harness(place, *arguments):
    command = [sys.executable, "-m", "harness.cli.main", *arguments, "--workspace", str(place.root)]
    return subprocess.run(
        [*command, "--manifest", str(SHIPPED)], capture_output=True, text=True, check=False
    )


@pytest.mark.nightly
@pytest.mark.parametrize(
    "arguments",
    [
        ("eval", "--method", "hull8", "--dataset", SEALED, "--subjects", "s01"),
        ("data", "show", "s01", "--dataset", SEALED),
        ("report", "--run", "golden", "--figure", "overlay"),
        ("score", ".", "--dataset", SEALED, "--name", "mine"),
    ],
    ids=["eval", "show", "figure", "score"],
)
def test_every_verb_that_looks_ends_with_one_sentence_and_2(place, arguments):
    if "report" in arguments:
        run = place.run("golden")
        shutil.copytree(SHIPPED.parent / "tests" / "golden" / "run", run)
        RunStore(run).begin()
        for record in run.rglob("record.json"):
            text = record.read_text().replace('"dataset": "avatars"', f'"dataset": "{SEALED}"')
            for k in (1, 2, 3):
                text = text.replace(f'"a0{k}"', f'"s0{k}"')
            record.write_text(text)
    done = harness(place, *arguments)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("harness: ")
    assert f"dataset '{SEALED}' is sealed" in done.stderr
    assert "--reason" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.nightly
def test_a_dry_run_only_announces(place):
    done = harness(
        place, "eval", "--method", "hull8", "--dataset", SEALED, "--subjects", "s01", "--dry-run"
    )
    assert done.returncode == 0, done.stderr
    assert "is sealed" in done.stderr
    assert "1 of 1 cells would run" in done.stdout
