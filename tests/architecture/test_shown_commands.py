"""Every command that the site shows is tried in a way that is written down, and can be parsed."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer

from harness.cli.verb_list import all_verbs, verb_command
from harness.core.errors import HarnessError
from tests.architecture.test_documents import commands

ROOT = Path(__file__).parents[2]
SITE = ROOT / "docs" / "site"
#: What typer raises of a wrong command line, from the click that it brings.
_Refused = next(each for each in typer.BadParameter.__mro__ if each.__name__ == "ClickException")


@pytest.fixture(scope="module")
def record() -> Any:
    """The module that knows the commands, their plan and what was run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SITE))
        yield importlib.import_module("shown_commands")


@pytest.fixture(scope="module")
def shown(record: ModuleType) -> dict[str, tuple[str, ...]]:
    return record.shown_commands(ROOT)


def parsed(words: list[str]) -> str:
    """What the command line says of the words after ``harness`` before it does anything."""
    rest = list(words)
    name = rest.pop(0) if rest else ""
    if name not in all_verbs():
        return f"no command '{name}'"
    command = verb_command(name)
    while subcommands := getattr(command, "commands", None):
        if not rest or rest[0] not in subcommands:
            return f"no command '{' '.join([name, *rest[:1]])}'"
        command = subcommands[rest.pop(0)]
    try:
        command.make_context(name, rest)
    except _Refused as error:
        return error.format_message()
    return ""


def names_of_tests(path: Path) -> set[str]:
    return {
        node.name
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    }


def test_commands_are_read_as_a_reader_copies_them(record: ModuleType, tmp_path: Path) -> None:
    # Each form once: a comment, a line that goes on, answers in a console, other languages.
    text = (
        "```sh\nharness a --x '#1'   # a comment\nharness b \\\n    --y &&\nharness c\n```\n"
        "```console\n$ harness d\nan answer\n```\n```python\nharness = 1\n```\n"
    )

    assert list(record.commands_in(text)) == [
        "harness a --x '#1'",
        "harness b --y && harness c",
        "harness d",
    ]


def test_no_command_hides_in_a_block_of_another_kind() -> None:
    hidden = [
        (path.name, line)
        for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
        for language, block in re.findall(
            r"^```(\w*)[^\n]*\n(.*?)^```$", path.read_text("utf-8"), re.MULTILINE | re.DOTALL
        )
        if language not in ("sh", "console")
        for line in block.splitlines()
        if re.match(r"(?:\$ )?(?:harness|python3?|pip|pytest|colmap|cd) (?!=)", line)
    ]

    assert hidden == []


def test_every_command_was_run_or_it_is_written_down_why_not(
    record: ModuleType, shown: dict[str, tuple[str, ...]]
) -> None:
    plan, ran = record.load_plan(), record.load_ran()
    wanted = {each for each in shown if plan.trial(each).how == "run"}

    assert len(shown) > 100
    assert sorted(wanted - set(ran)) == [], "run 'python docs/site/run_commands.py'"
    assert [each for each in ran if plan.trial(each).how == "due"] == [], "these were run"
    assert [each for each in wanted if ran[each].ran != plan.line(each)] == []
    assert [each for each in ran if ran[each].exit_code != plan.trial(each).exit_code] == []


def test_nothing_is_written_down_of_commands_that_are_gone(
    record: ModuleType, shown: dict[str, tuple[str, ...]]
) -> None:
    plan = record.load_plan()

    assert sorted({*plan.trials, *plan.prepare, *record.load_ran()} - set(shown)) == []


def test_tests_that_stand_for_a_command_are_there(record: ModuleType) -> None:
    named = [trial for trial in record.load_plan().trials.values() if trial.instead]

    assert [each.shown for each in record.load_plan().trials.values()
            if each.how == "test" and not each.instead] == []  # fmt: skip
    for trial in named:
        path, _, name = trial.instead.partition("::")
        assert name in names_of_tests(ROOT / path), trial.instead


def test_what_the_integration_runs_are_commands_of_the_readme(record: ModuleType) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    marked = re.findall(r"<!-- command \d -->\n(```sh\n.*?^```$)", readme, re.MULTILINE | re.DOTALL)
    firsts = {command for block in marked for command in record.commands_in(block)}
    plan = record.load_plan()
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    by_ci = [each for each in plan.trials.values() if each.how == "ci"]

    assert len(firsts) == 2
    assert firsts <= {each.shown for each in by_ci}
    # What is neither such a command nor a line of the script says what of it is the same.
    assert [
        each.shown
        for each in by_ci
        if each.shown not in firsts and each.shown not in script and not each.because
    ] == []


def test_every_command_can_be_parsed(record: ModuleType, shown: dict[str, tuple[str, ...]]) -> None:
    plan = record.load_plan()
    lines = [*shown, *(plan.line(each) for each in shown)]
    words = [words for line in lines for words in commands(f"```sh\n{line}\n```\n")]

    assert len(words) > 200
    assert [(shlex.join(each), said) for each in words if (said := parsed(each))] == []


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("evaluate", "no command 'evaluate'"),
        ("data", "no command 'data'"),
        ("eval --methods hull8", "No such option: --methods"),
        ("eval --jobs many", "valid integer"),
        ("score", "Missing"),
        ("score a.ply b.ply", "unexpected extra argument"),
    ],
)
def test_the_parsing_bites(line: str, said: str) -> None:
    assert said in parsed(line.split())


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (2 * '[[command]]\nshown = "x"\n', "two entries"),
        ('[[command]]\nshown = "x"\nhow = "guess"\n', "unknown way"),
        ('[[command]]\nshown = "x"\nran = "y"\n', "does not say why"),
        ('[[command]]\nshown = "x"\nhow = "due"\n', "does not say why"),
    ],
)
def test_a_plan_without_reasons_is_refused(
    record: ModuleType, tmp_path: Path, entries: str, message: str
) -> None:
    (tmp_path / "plan.toml").write_text(entries)

    with pytest.raises(HarnessError, match=message):
        record.load_plan(tmp_path / "plan.toml")


def test_a_placeholder_is_replaced_as_a_whole_word(record: ModuleType) -> None:
    plan = record.Plan({"FILE": "net.onnx", "FILE.onnx": "other.onnx"})

    assert plan.line("import FILE --name FILES") == "import net.onnx --name FILES"
    assert plan.line("import FILE.onnx") == "import other.onnx"
