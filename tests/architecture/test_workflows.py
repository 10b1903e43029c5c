"""The workflows: their commands exist, and what others hand in is read as data and never run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.architecture.test_documents import commands, complaint

ROOT = Path(__file__).parents[2]
WORKFLOWS = {
    path.stem: yaml.safe_load(path.read_text(encoding="utf-8"))
    for path in sorted((ROOT / ".github" / "workflows").glob("*.yml"))
}
BOARD: dict[str, Any] = WORKFLOWS["board"]


def scripts(workflow: dict[str, Any]) -> list[str]:
    return [
        step["run"] for job in workflow["jobs"].values() for step in job["steps"] if "run" in step
    ]


def harness_commands(workflow: dict[str, Any]) -> list[list[str]]:
    return [words for text in scripts(workflow) for words in commands(f"```sh\n{text}\n```\n")]


@pytest.mark.parametrize("name", WORKFLOWS)
def test_every_command_of_a_workflow_exists_with_its_options(name: str) -> None:
    # What follows a redirection is no word of the command.
    found = [words[: words.index(">") if ">" in words else None] for words in
             harness_commands(WORKFLOWS[name])]  # fmt: skip

    assert found
    assert [text for text in map(complaint, found) if text] == []


@pytest.mark.parametrize("name", WORKFLOWS)
def test_no_script_has_texts_of_others_pasted_into_it(name: str) -> None:
    assert [text for text in scripts(WORKFLOWS[name]) if "${{" in text] == []


def test_the_board_is_checked_where_results_change() -> None:
    # YAML 1.1 reads the key "on" as true.
    assert BOARD[True] == {"pull_request_target": {"paths": ["results/**"]}}
    names = [words[:2] for words in harness_commands(BOARD)]
    assert ["results", "compare"] in names
    assert ["results", "verify"] in names


def test_the_job_that_reads_a_submission_cannot_write() -> None:
    verify, comment = BOARD["jobs"]["verify"], BOARD["jobs"]["comment"]

    assert BOARD["permissions"] == {"contents": "read"}
    assert "permissions" not in verify
    assert comment["permissions"] == {"pull-requests": "write"}
    assert not [step for step in comment["steps"] if "checkout" in step.get("uses", "")]


def test_nothing_of_a_submission_is_run() -> None:
    (own, theirs) = [
        step["with"]
        for step in BOARD["jobs"]["verify"]["steps"]
        if "checkout" in step.get("uses", "")
    ]

    assert "ref" not in own
    assert "path" not in own
    assert (theirs["path"], theirs["sparse-checkout"]) == ("submission", "results")
    assert own["persist-credentials"] is theirs["persist-credentials"] is False
    lines = [line for text in scripts(BOARD) for line in text.splitlines() if "submission" in line]
    assert [
        line
        for line in lines
        if not line.strip().startswith(("harness results ", 'test -z "$(find'))
    ] == ["  # Texts of the submission end no block."]
