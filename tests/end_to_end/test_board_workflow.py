"""The steps of the board's workflow, run here as they run there."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from harness.board.copying import export_results
from harness.run.store import RunStore
from harness.run.workspace import Workspace

WORKFLOW = Path(__file__).parents[2] / ".github" / "workflows" / "board.yml"
STEPS = {
    step["name"]: step["run"]
    for step in yaml.safe_load(WORKFLOW.read_text())["jobs"]["verify"]["steps"]
    if "run" in step
}


@pytest.fixture
def board(world: Path, measured: None) -> Path:
    """The world as the workflow has it: a board, and a submission with a second version."""
    store = RunStore.existing(Workspace(world), None)
    export_results(store, store.records(), "1", world / "results")
    shutil.copytree(world / "results", world / "submission" / "results")
    export_results(store, store.records(), "2", world / "submission" / "results")
    return world


def run(world: Path, name: str) -> int:
    """Run one step with the command line of this environment; its exit code."""
    programs = world / "bin"
    programs.mkdir(exist_ok=True)
    (programs / "harness").write_text(
        f'#!/bin/sh\nexec {sys.executable} -m harness.cli.main "$@"\n'
    )
    (programs / "harness").chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{programs}:{os.environ['PATH']}",
        "GITHUB_STEP_SUMMARY": str(world / "summary.md"),
    }
    command = ["bash", "-e", "-o", "pipefail", "-c", STEPS[name]]
    return subprocess.run(command, cwd=world, env=environment, check=False).returncode


def codes(world: Path) -> list[int]:
    return [run(world, name) for name in ("What changes", "Score the meshes again", "The comment")]


@pytest.mark.nightly
def test_a_right_submission_gets_its_table(board: Path) -> None:
    assert codes(board) == [0, 0, 0]

    comment = (board / "comment.md").read_text()
    assert "| `gt/2` | `gt/1` | 3 | 0 | " in comment
    assert "gt/2: 3 meshes scored again, 0 failed, 0 findings" in comment
    assert "gt/1:" not in comment
    assert (board / "summary.md").read_text() == comment


@pytest.mark.nightly
def test_a_lost_subject_and_a_changed_number_fail_and_are_said(board: Path) -> None:
    folder = board / "submission" / "results" / "gt" / "2"
    (folder / "t3.json").unlink()
    document = json.loads((folder / "t1.json").read_text())
    document["metrics"]["normal_error"]["value"] -= 0.5
    (folder / "t1.json").write_text(json.dumps(document))

    assert codes(board) == [1, 1, 0]
    comment = (board / "comment.md").read_text()
    assert "* `gt/2`: lost subjects that `gt/1` has: t3" in comment
    assert "WRONG  gt/2, t3: no record" in comment
    assert "WRONG  gt/2, t1: normal_error is " in comment


def test_a_link_to_another_file_is_refused(board: Path) -> None:
    step = "Results are files and not links to others"
    assert run(board, step) == 0

    (board / "submission" / "results" / "gt" / "2" / "t9.ply").symlink_to("t1.ply")
    assert run(board, step) == 1
