"""The commands that the pages show, as a reader copies them, and how each of them is tried.

``commands.toml`` says which commands cannot be tried as they stand. ``run_commands.py`` runs all
others literally, and it alone writes ``commands.json``.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from harness.core.errors import HarnessError
from harness.core.files.atomic import write_text
from layout import load_navigation

_HERE = Path(__file__).parent
_BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_COMMENT = re.compile(r"(?:^|\s+)#(?: .*)?$")
_WAYS = ("run", "ci", "test", "due", "not run")


@dataclass(frozen=True, slots=True)
class Trial:
    """How a command is tried.

    Attributes:
        shown: The command as a page shows it, on one line and without its comment.
        how: ``run`` by ``run_commands.py``; ``due`` where nobody has run it so yet; ``ci`` for what
            ``.ci/run`` runs; ``test`` where a test does the same on something small; ``not run``.
        ran: What is run in its place; empty where it is the command itself.
        because: Why it is not the command itself.
        instead: The test, ``path::name``, that does the same or comes closest; may be empty.
        exit_code: What the page says that the command ends with.
    """

    shown: str
    how: str = "run"
    ran: str = ""
    because: str = ""
    instead: str = ""
    exit_code: int = 0


@dataclass(frozen=True, slots=True)
class Plan:
    """What ``commands.toml`` holds.

    Attributes:
        replace: Texts that stand for something of the reader's, and what is put there.
        prepare: By a shown command, the shell commands that make what it needs.
        trials: By shown command; one that is not here is run as it stands.
    """

    replace: Mapping[str, str] = field(default_factory=dict[str, str])
    prepare: Mapping[str, str] = field(default_factory=dict[str, str])
    trials: Mapping[str, Trial] = field(default_factory=dict[str, Trial])

    def trial(self, shown: str) -> Trial:
        """How a shown command is tried."""
        return self.trials.get(shown, Trial(shown))

    def line(self, shown: str) -> str:
        """What is run for a shown command."""
        line = self.trial(shown).ran or shown
        for text, there in self.replace.items():
            line = re.sub(rf"(?<![\w/.]){re.escape(text)}(?![\w.])", lambda _, to=there: to, line)
        return line


@dataclass(frozen=True, slots=True)
class Ran:
    """What a command did when it was run.

    Attributes:
        ran: What was run.
        exit_code: How it ended.
        seconds: How long it took, on a machine that may have had other work.
        date: Day in UTC.
        version: The harness's version.
        commit: The commit whose files it was run on.
    """

    ran: str
    exit_code: int
    seconds: float
    date: str
    version: str
    commit: str


def commands_in(text: str) -> Iterator[str]:
    """The commands in the shell blocks of a page, each on one line and without its comment."""
    for language, block in _BLOCK.findall(text):
        if language not in ("sh", "console"):
            continue
        lines = re.sub(r"(\\|(?<=&&))\n\s*", " ", block).splitlines()
        for line in lines:
            if language == "console" and not line.startswith("$ "):
                continue
            bare = _COMMENT.sub("", line).removeprefix("$ ")
            if command := re.sub(r"\s+", " ", bare).strip():
                yield command


def shown_commands(root: Path) -> dict[str, tuple[str, ...]]:
    """The files that show a command, by command, in the order of the site.

    Lines that end in a backslash or in ``&&`` go on in the next line. A ``console`` block shows
    answers, too; its commands follow ``$``.

    Args:
        root: The repository.
    """
    site = load_navigation(root, _HERE / "navigation.toml")
    found: dict[str, tuple[str, ...]] = {}
    for file in ("README.md", *site.files.values()):
        for command in commands_in((root / file).read_text(encoding="utf-8")):
            found[command] = (*found.get(command, ()), file)
    return found


def load_plan(path: Path = _HERE / "commands.toml") -> Plan:
    """How commands are tried.

    Raises:
        HarnessError: a command has two entries, an unknown way, or no reason for another command.
    """
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    trials: dict[str, Trial] = {}
    for entry in document.get("command", ()):
        trial = Trial(**entry)
        if trial.shown in trials:
            raise HarnessError(f"{path} has two entries of '{trial.shown}'")
        if trial.how not in _WAYS:
            raise HarnessError(
                f"{path}: unknown way to try '{trial.shown}'", got=trial.how, expected=str(_WAYS)
            )
        literally = trial.how in ("run", "ci") and not trial.ran and not trial.exit_code
        if not (literally or trial.because):
            raise HarnessError(f"{path} does not say why '{trial.shown}' is not tried as it stands")
        trials[trial.shown] = trial
    return Plan(document.get("replace", {}), document.get("prepare", {}), trials)


def load_ran(path: Path = _HERE / "commands.json") -> dict[str, Ran]:
    """What was run, by shown command; nothing before the first time."""
    if not path.exists():
        return {}
    stored = json.loads(path.read_text(encoding="utf-8"))
    return {shown: Ran(**values) for shown, values in stored.items()}


def write_ran(ran: Mapping[str, Ran], path: Path = _HERE / "commands.json") -> None:
    """Store what was run."""
    values = {shown: asdict(each) for shown, each in ran.items()}
    write_text(path, json.dumps(values, indent=1, ensure_ascii=False) + "\n")
