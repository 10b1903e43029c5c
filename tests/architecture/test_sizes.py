"""Modules and functions stay readable, and no module is a drawer for odds and ends."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from harness import OFFERED

ROOT = Path(__file__).parents[2]
PACKAGES = ("harness", "renderers", "methods", "metrics", "reports")
#: Folders of modules: our packages, and those beside the bench.
FOLDERS = [*(ROOT / name for name in PACKAGES)]
FOLDERS += sorted(path.parent for path in ROOT.glob("packages/*/*/__init__.py"))
EVALUATE = {(OFFERED["evaluate"], "evaluate")}
MODULE_LINES, FUNCTION_LINES, PARAMETERS = 600, 60, 6
DRAWERS = {"common", "helper", "helpers", "misc", "util", "utils"}


def complaints(name: str, source: str) -> list[str]:
    """What is too large in a module or wrong with its name."""
    found: list[str] = []
    if Path(name).stem in DRAWERS or DRAWERS & set(Path(name).parts):
        found.append(f"{name}: a module says what is in it")
    lines = source.count("\n")
    if lines > MODULE_LINES:
        found.append(f"{name}: {lines} lines")
    if re.search(r"^__all__\b", source, re.MULTILINE):
        found.append(f"{name}: a leading underscore says what is private, and no __all__")
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
        length = (node.end_lineno or first) - first + 1
        if length > FUNCTION_LINES:
            found.append(f"{name}:{node.lineno} {node.name}: {length} lines")
        arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
        count = len([argument for argument in arguments if argument.arg not in ("self", "cls")])
        # The command line's options are the parameters of its verbs, and of the same from Python.
        if (
            count > PARAMETERS
            and not name.startswith("harness/cli/")
            and not name.endswith("verb.py")
            and (name.removesuffix(".py").replace("/", "."), node.name) not in EVALUATE
        ):
            found.append(f"{name}:{node.lineno} {node.name}: {count} parameters")
    return found


def test_every_module_fits() -> None:
    paths = [path for folder in FOLDERS for path in sorted(folder.rglob("*.py"))]
    found = [
        complaint
        for path in paths
        for complaint in complaints(path.relative_to(ROOT).as_posix(), path.read_text())
    ]

    assert len(paths) > 50
    assert found == []


def test_every_folder_says_what_lives_there() -> None:
    folders = {path.parent for root in FOLDERS for path in root.rglob("*.py")}
    silent = [
        folder.relative_to(ROOT).as_posix()
        for folder in sorted(folders)
        if not ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))
    ]

    assert silent == []


def test_tests_have_no_drawers_either() -> None:
    names = {path.stem for path in (ROOT / "tests").rglob("*.py")}

    assert names & DRAWERS == set()


@pytest.mark.parametrize(
    ("name", "source", "complaint"),
    [
        ("metrics/a.py", "__all__ = ['f']", "no __all__"),
        ("harness/core/a.py", "x = 1\n" * 601, "harness/core/a.py: 601 lines"),
        ("metrics/a.py", "def f():\n" + "    x = 1\n" * 60, "metrics/a.py:1 f: 61 lines"),
        ("metrics/a.py", "class A:\n def f(self, a, b, c, *, d, e, f, g): ...", "f: 7 parameters"),
        ("metrics/utils.py", "", "a module says what is in it"),
        ("metrics/helpers/a.py", "", "a module says what is in it"),
    ],
)
def test_the_gate_bites(name: str, source: str, complaint: str) -> None:
    assert [text for text in complaints(name, source) if complaint in text]


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("harness/core/a.py", "x = 1\n" * 600),
        ("metrics/a.py", "def f():\n" + "    x = 1\n" * 59),
        ("metrics/a.py", "class A:\n def f(self, a, b, c, *, d, e, f): ..."),
        ("harness/cli/a.py", "def f(a, b, c, d, e, f, g): ..."),
    ],
)
def test_the_gate_lets_pass_what_fits(name: str, source: str) -> None:
    assert complaints(name, source) == []
