"""Answers of Slurm's jobs: taken when they are whole."""

from __future__ import annotations

from pathlib import Path

from harness.core.files.atomic import write_json
from harness.core.typed_json import to_json
from harness.run import slurm
from harness.run.slurm import Slurm
from harness.run.task import Answer


def test_an_answer_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    answers = tmp_path / "answers"
    whole, half = answers / "a.json", answers / ".b.json.0123.part.json"
    for path, name in ((whole, "one"), (half, "two")):
        write_json(path, to_json(Answer(name, {"line": ""})))
    tasks = {name: name for name in ("one", "two")}
    taken: list[Answer] = []

    found = slurm._Round(Slurm(tmp_path), None, tmp_path, [])._take(tasks, taken.append)

    assert (found, [answer.task for answer in taken]) == (1, ["one"])
    assert not whole.exists()
    assert half.is_file()
