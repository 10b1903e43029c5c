"""The documents name files, commands, options and numbers that exist."""

from __future__ import annotations

import ast
import importlib
import itertools
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

import harness
from harness.cli.verb_list import all_verbs, verb_command
from harness.core.process.source_digest import OUR_PACKAGES
from harness.core.protocols import Privilege
from methods.catalog import METHODS

ROOT = Path(__file__).parents[2]
DOCUMENTS = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])
NAMES = [path.relative_to(ROOT).as_posix() for path in DOCUMENTS]

LINK = re.compile(r"\]\(([^)\s]+)\)")
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"^```(?:sh|console)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def anchors(text: str) -> set[str]:
    """The fragments that a Markdown page's headings give."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title).strip().lower().replace(" ", "-") for title in headings}


def broken_links(path: Path, text: str) -> list[str]:
    """Links of a page to files or headings that are not there."""
    found: list[str] = []
    for target in LINK.findall(text):
        if re.match(r"https?:", target):
            continue
        name, _, fragment = target.partition("#")
        there = (path.parent / name).resolve() if name else path
        is_there = there.exists()
        if is_there and fragment:
            is_there = fragment in anchors(there.read_text(encoding="utf-8"))
        if not is_there:
            found.append(target)
    return found


def commands(text: str) -> Iterator[list[str]]:
    """The ``harness`` commands in a page's shell blocks, as words."""
    for block in BLOCK.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line.removeprefix("$ "), comments=True)
            while words and "=" in words[0]:
                words.pop(0)
            if words and Path(words[0]).name == "harness":
                yield words[1:]


def complaint(words: list[str]) -> str:
    """What is wrong with the words after ``harness``; empty where nothing is."""
    rest = list(words)
    verb = rest.pop(0) if rest else ""
    if verb not in all_verbs():
        return f"no command '{verb}' in: harness {' '.join(words)}"
    command: Any = verb_command(verb)
    while subcommands := getattr(command, "commands", None):
        name = rest.pop(0) if rest else ""
        if name not in subcommands:
            return f"no command '{name}' in: harness {' '.join(words)}"
        command = subcommands[name]
    options = {option for parameter in command.params for option in parameter.opts}
    unknown = [word for word in rest if word.startswith("-") and word not in options]
    return f"no {', '.join(unknown)} in: harness {' '.join(words)}" if unknown else ""


@pytest.mark.parametrize("name", NAMES)
def test_every_link_leads_somewhere(name: str) -> None:
    path = ROOT / name

    assert broken_links(path, path.read_text(encoding="utf-8")) == []


def test_the_search_for_broken_links_bites(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# One heading, here\n")
    text = "[a](page.md) [b](gone.md) [c](#one-heading-here) [d](page.md#no) [e](https://x.y/z)"

    assert broken_links(page, text) == ["gone.md", "page.md#no"]


@pytest.mark.parametrize("name", NAMES)
def test_every_command_exists_with_its_options(name: str) -> None:
    found = map(complaint, commands((ROOT / name).read_text(encoding="utf-8")))

    assert [text for text in found if text] == []


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("harness evaluate --method hull8", "no command 'evaluate'"),
        ("harness eval --methods hull8", "--methods"),
        ("harness data", "no command ''"),
        ("X=1 .venv/bin/harness report --jobs 2  # a comment", "--jobs"),
    ],
)
def test_the_check_of_commands_bites(line: str, part: str) -> None:
    (words,) = commands(f"```sh\n{line}\n```\n")

    assert part in complaint(words)


def missing_imports(source: str) -> list[str]:
    """Names that Python code imports from our packages and that are not there."""
    found: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OUR_PACKAGES:
            module = importlib.import_module(node.module or "")
            found += [alias.name for alias in node.names if not hasattr(module, alias.name)]
    return found


@pytest.mark.parametrize("name", NAMES)
def test_python_in_the_documents_imports_what_is_there(name: str) -> None:
    blocks = PYTHON.findall((ROOT / name).read_text(encoding="utf-8"))

    assert [missing_imports(block) for block in blocks] == [[] for _ in blocks]


def test_the_check_of_imports_bites() -> None:
    source = "from harness.core.mesh import Mesh, Mush\nfrom os import nothing\n"

    assert missing_imports(source) == ["Mush"]


def test_the_documents_show_every_command() -> None:
    shown = {
        words[0]
        for path in DOCUMENTS
        for words in commands(path.read_text(encoding="utf-8"))
        if words
    }

    assert len(all_verbs()) > 8
    assert set(all_verbs()) - shown == set()


def test_the_reading_order_is_that_of_the_package() -> None:
    page = (ROOT / "docs" / "how_it_works.md").read_text(encoding="utf-8")
    in_package = re.findall(r"^\d\. ``(.+?)``", harness.__doc__ or "", re.MULTILINE)

    assert len(in_package) == 8
    assert re.findall(r"^\d\. `(.+?)`", page, re.MULTILINE) == in_package


def test_every_privilege_is_explained() -> None:
    page = (ROOT / "docs" / "how_it_works.md").read_text(encoding="utf-8")

    assert [each.label for each in Privilege if f"| {each.label} |" not in page] == []


def test_every_method_is_explained() -> None:
    ours = [name for name in METHODS if METHODS.module(name).startswith("methods.")]
    page = (ROOT / "docs" / "how_it_works.md").read_text(encoding="utf-8")

    assert [name for name in ours if f"`{name}`" not in page] == []


def test_every_setting_in_the_documents_exists() -> None:
    nested = [METHODS.resolve(name).info.parameters for name in ("econ", "mexecon8", "hull8")]
    known = {
        f"{step}.{setting}"
        for parameters in nested
        for step, settings in parameters.items()
        for setting in settings
    }
    texts = [path.read_text(encoding="utf-8") for path in DOCUMENTS if path.name != "methods.md"]
    # After --set, or first in a row of a table.
    named = {
        name
        for text in texts
        for name in re.findall(r"(?:--set |^\| `)((?:body|surface|hull)\.\w+)", text, re.MULTILINE)
    }

    assert {"hull.voxel_m", "surface.normals", "body.depth"} <= named
    assert named - known == set()


def test_the_citation_is_of_this_version_and_names_the_paper() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))

    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert str(citation["version"]) == harness.__version__
    assert citation["license"] == "Apache-2.0"
    (paper,) = citation["references"]
    assert paper["title"].startswith("MExECON: ")
    assert paper["authors"][0]["family-names"] == "Uğur"


def cells(line: str) -> list[str]:
    """A table row's cells without footnotes and bold."""
    row = re.sub(r"<sup>.*?</sup>|\*\*", "", line)
    return [cell.strip() for cell in row.strip().strip("|").split("|")]


def test_the_table_of_the_readme_is_that_of_the_results() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = iter(readme[readme.index("| Method | Chamfer") :].splitlines())
    rows = [cells(line) for line in itertools.takewhile(lambda line: line.startswith("|"), lines)]
    results = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    table = results[results.index("| Method | Chamfer") :]
    stored = [cells(line) for line in table[: table.index("\n\n")].splitlines()]

    assert len(rows) > 5
    assert [row for row in rows if row not in stored] == []


def test_the_top_of_the_readme_shows_picture_table_and_command() -> None:
    top = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()[:30]

    assert any(line.startswith("![") for line in top)
    assert any(line.startswith("| Method | Chamfer") for line in top)
    assert any(line.startswith("$ harness ") for line in top)
