"""The verbs: what ``--help`` says, how fast it says it, and that every option is explained."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from collections.abc import Iterator

import pytest
from typer.testing import CliRunner

from harness.cli.display import deliver
from harness.cli.main import app
from harness.cli.verb_list import all_verbs, verb_command

MOST_HELP_S = 0.3


def commands() -> Iterator[tuple[str, object]]:
    """Every command with its full name, those of groups included."""
    for name in all_verbs():
        command = verb_command(name)
        inner = getattr(command, "commands", {})
        yield name, command
        yield from ((f"{name} {one}", inner[one]) for one in inner)


COMMANDS = dict(commands())


def shown(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == 0, result.output
    return " ".join(result.stdout.split())


@pytest.mark.parametrize("name", list(all_verbs()))
def test_the_list_of_verbs_says_what_a_verbs_own_help_says_first(name: str) -> None:
    own = (COMMANDS[name].help or "").split("\n\n")[0]
    assert " ".join(own.split()) == all_verbs()[name]
    assert all_verbs()[name] in shown(name, "--help")


def test_no_summary_is_cut_off() -> None:
    listing = shown("--help")
    assert [summary for summary in all_verbs().values() if summary not in listing] == []


@pytest.mark.parametrize("name", list(COMMANDS))
def test_every_option_is_explained_by_a_phrase(name: str) -> None:
    for option in COMMANDS[name].params:
        text = option.help or ""
        assert re.match(r"[A-Z]\S* \S+ .*\.$", text), f"{name} {option.name}: '{text}'"
        assert not text.startswith("Of "), f"{name} {option.name}"


def test_a_mistyped_verb_is_answered_with_the_nearest_one() -> None:
    result = CliRunner().invoke(app, ["repor"])
    assert result.exit_code == 2
    assert "Did you mean 'report'?" in result.output


def test_help_costs_less_than_a_blink() -> None:
    """Processor time, of which a busy machine takes nothing away; the best of three."""
    taken_s = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "harness.cli.main", "--help"]
        subprocess.run(command, check=True, capture_output=True, env=os.environ)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken_s.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert min(taken_s) < MOST_HELP_S


def test_a_text_is_printed_or_written(tmp_path, capsys) -> None:
    deliver("one line", None)
    deliver("two\nlines\n", None)
    deliver("a table\n", tmp_path / "table.md")
    assert capsys.readouterr().out == f"one line\ntwo\nlines\n{tmp_path / 'table.md'}\n"
    assert (tmp_path / "table.md").read_text() == "a table\n"
