"""Our own packages are imported at the top of a module, but for entry points that must be light.

An import within a function hides what a module needs, and often a circle. It stays where it saves
time that a user waits for, and where the list below says so.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("harness", "renderers", "methods", "metrics", "reports")
#: Folders of modules: our packages, and those beside the bench.
FOLDERS = [*(ROOT / name for name in PACKAGES)]
FOLDERS += sorted(path.parent for path in ROOT.glob("packages/*/*/__init__.py"))
OURS = {folder.name for folder in FOLDERS}

#: Modules whose functions import our own packages, and why.
ALLOWED = {
    "packages/normal-training/normal_training/train_normals.py": (
        "'harness train --help' shows the defaults of these settings and must not wait for "
        "PyTorch, which the modules that train import"
    ),
    "methods/photo_pull/pulled.py": (
        "Warp takes a second to start, and methods are listed without it"
    ),
}


def local_imports(source: str) -> Iterator[tuple[int, str]]:
    """Line and module of each import of our own packages within a function."""
    functions = (
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    )
    found = {(line, name) for function in functions for line, name in _imports_in(function)}
    yield from sorted(found)


def _imports_in(function: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(function):
        if isinstance(node, ast.ImportFrom):
            # A relative import is one of our own, too.
            names = [f"{PACKAGES[0]}.{node.module or ''}" if node.level else node.module or ""]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        yield from ((node.lineno, name) for name in names if name.split(".")[0] in OURS)


def all_local_imports() -> dict[str, list[tuple[int, str]]]:
    """The local imports of every module of the product that has any, by its path."""
    paths = [path for folder in FOLDERS for path in sorted(folder.rglob("*.py"))]
    assert len(paths) > 50
    found = {
        path.relative_to(ROOT).as_posix(): list(local_imports(path.read_text())) for path in paths
    }
    return {name: imports for name, imports in found.items() if imports}


def test_functions_do_not_import_our_own_packages() -> None:
    hidden = [
        f"{name}:{line} imports {module}"
        for name, imports in all_local_imports().items()
        if name not in ALLOWED
        for line, module in imports
    ]

    assert hidden == []


def test_the_list_names_only_modules_that_need_it() -> None:
    assert set(ALLOWED) <= set(all_local_imports())
    assert all(len(reason) > 20 for reason in ALLOWED.values())


@pytest.mark.parametrize(
    "source",
    [
        "def f():\n    import harness.core",
        "def f():\n    from methods.catalog import METHODS",
        "async def f():\n    from metrics import score",
        "class A:\n    def f(self):\n        if self:\n            import reports.tables as t",
        "def f():\n    def g():\n        from . import other",
    ],
)
def test_the_search_bites(source: str) -> None:
    assert len(list(local_imports(source))) == 1


@pytest.mark.parametrize(
    "source",
    [
        "import harness.core\nfrom methods import catalog",
        "def f():\n    import torch\n    from scipy import ndimage",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import methods.catalog",
        "def f():\n    import harness_of_another",
    ],
)
def test_other_imports_pass(source: str) -> None:
    assert list(local_imports(source)) == []
