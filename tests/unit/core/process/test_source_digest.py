"""What a result's code is: which modules count, which lines of them, and which packages."""

from __future__ import annotations

import os
from importlib import metadata
from pathlib import Path

import pytest

from harness.core.errors import HarnessError
from harness.core.process import source_digest as module_source
from harness.core.process.source_digest import SourceTree

MODULES = {
    "methods/__init__.py": "",
    "methods/one.py": '''"""Its docstring."""
from __future__ import annotations
from typing import TYPE_CHECKING
import numpy as np
from methods.parts import first, second
if TYPE_CHECKING:
    from methods.types import Thing
    import torch


def run(x: Thing) -> int:
    """Its docstring."""
    from methods import late
    import scipy.spatial.distance as distance  # only here
    return first + 1
''',
    "methods/types.py": "Thing = int\n",
    "methods/late.py": "import json\nfrom . import relative\nWORKER = 'methods.job.worker'\n",
    "methods/relative.py": "from .parts.deep import deepest\n",
    "methods/job/__init__.py": "",
    "methods/job/worker.py": "import skimage\n",
    "methods/parts/__init__.py": "from methods.parts.first import first\nsecond = 2\n",
    "methods/parts/first.py": "first = 1\n",
    "methods/parts/deep.py": "deepest = 3\n",
    "methods/catalog.py": "TARGETS = {'one': 'methods.one:run', 'two': 'methods.two:run'}\n",
    "methods/two.py": "import methods.catalog\nfrom methods.one import run as other\n",
    "methods/unused.py": "unused = 0\n",
}
USED = {
    "methods", "methods.one", "methods.parts", "methods.parts.first", "methods.late",
    "methods.relative", "methods.parts.deep", "methods.job", "methods.job.worker",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in MODULES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def edit(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    stamp = path.stat().st_mtime_ns
    path.write_text(text.replace(before, after))
    # Some file systems count time in coarse steps.
    os.utime(path, ns=(stamp + 1, stamp + 1))


def test_the_closure_follows_every_import_and_nothing_else(folder: Path) -> None:
    found = SourceTree.below(folder).digest(["methods.one"])

    assert set(found.modules) == USED
    assert dict(found.packages) == {
        name: metadata.version(name) for name in ("numpy", "scikit-image", "scipy")
    }


def test_a_catalogues_targets_are_not_followed(folder: Path) -> None:
    assert set(SourceTree.below(folder).digest(["methods.catalog"]).modules) == {
        "methods", "methods.catalog",
    }  # fmt: skip
    two = SourceTree.below(folder).digest(["methods.two"])
    assert set(two.modules) == USED | {"methods.two", "methods.catalog"}


@pytest.mark.parametrize(
    ("file", "before", "after", "module"),
    [
        ("methods/one.py", "first + 1", "first + 2", "methods.one"),
        ("methods/parts/__init__.py", "second = 2", "second = 3", "methods.parts"),
        ("methods/parts/deep.py", "3", "4", "methods.parts.deep"),
        ("methods/late.py", "import json", "import math", "methods.late"),
        ("methods/job/worker.py", "import skimage", "import skimage.io", "methods.job.worker"),
    ],
)
def test_one_line_of_a_used_module_is_seen(
    folder: Path, file: str, before: str, after: str, module: str
) -> None:
    tree = SourceTree.below(folder)
    old = tree.digest(["methods.one"]).modules
    edit(folder / file, before, after)
    new = tree.digest(["methods.one"]).modules

    assert {name for name in old if old[name] != new[name]} == {module}


@pytest.mark.parametrize(
    ("file", "before", "after"),
    [
        ("methods/unused.py", "unused = 0", "unused = 1"),
        ("methods/types.py", "int", "float"),
        ("methods/one.py", "Its docstring", "Another docstring"),
        ("methods/one.py", "  # only here", ""),
        ("methods/one.py", "first + 1", "(first\n        + 1)"),
        ("methods/one.py", "    import torch\n", ""),
        ("methods/relative.py", "from", "__version__ = '2'\nfrom"),
    ],
)
def test_what_decides_nothing_is_not_seen(folder: Path, file: str, before: str, after: str) -> None:
    tree = SourceTree.below(folder)
    old = tree.digest(["methods.one"])
    edit(folder / file, before, after)

    assert tree.digest(["methods.one"]) == old


def test_what_is_left_out_is_not_followed(folder: Path) -> None:
    found = SourceTree.below(folder).digest(["methods.one"], without=["methods.late"])

    assert set(found.modules) == {"methods", "methods.one", "methods.parts", "methods.parts.first"}
    assert set(found.packages) == {"numpy", "scipy"}


@pytest.mark.parametrize(
    "line",
    ["from harness import Mesh", "import harness; harness.Mesh", "import harness as h; h.Mesh"],
)
def test_a_public_name_counts_as_the_module_behind_it(folder: Path, line: str) -> None:
    """... and the door itself not, or one more name in it would make every record stale."""
    mesh = folder / "harness" / "core" / "mesh.py"
    mesh.parent.mkdir(parents=True)
    mesh.write_text("Mesh = 1\n")
    (folder / "harness" / "__init__.py").write_text("OFFERED = {}\n")
    (folder / "methods" / "one.py").write_text(f"{line}\n")
    found = SourceTree.below(folder).digest(["methods.one"])

    assert set(found.modules) == {"methods", "methods.one", "harness.core.mesh"}
    assert found.uses("Mesh")


def test_names_are_found_in_code_alone(folder: Path) -> None:
    found = SourceTree.below(folder).digest(["methods.one"])

    assert found.uses("first")
    assert not found.uses("Thing_that_is_not_there")
    edit(folder / "methods/late.py", "import json", "# Body\nimport json")
    assert not SourceTree.below(folder).digest(["methods.one"]).uses("Body")
    edit(folder / "methods/late.py", "# Body", "from harness.core.artifacts import Body")
    assert SourceTree.below(folder).digest(["methods.one"]).uses("Body")


def test_a_third_partys_own_package_is_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    theirs = tmp_path / "their_package_of_methods"
    theirs.mkdir()
    (theirs / "__init__.py").write_text("raise RuntimeError('nothing is imported')\n")
    (theirs / "method.py").write_text(
        "from harness.core import metric_catalog\nfrom . import part\n"
    )
    (theirs / "part.py").write_text("import scipy\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    found = SourceTree.installed("their_package_of_methods.method").digest(
        ["their_package_of_methods.method"]
    )

    assert {"their_package_of_methods.part", "harness.core.metric_catalog"} < set(found.modules)
    assert set(found.packages) == {"scipy"}


def test_a_package_that_is_not_installed_has_no_version(folder: Path) -> None:
    (folder / "methods/unused.py").write_text("import a_package_of_nobody\n")

    found = SourceTree.below(folder).digest(["methods.unused"])

    assert found.packages == {"a_package_of_nobody": ""}


def test_imports_lead_to_the_distributions_that_bring_them(folder: Path) -> None:
    every = metadata.packages_distributions()
    brought = {"PIL", "skimage", "yaml", "onnx", "_pytest"}
    (folder / "methods/unused.py").write_text("".join(f"import {name}\n" for name in brought))

    found = SourceTree.below(folder).digest(["methods.unused"])

    assert set(found.packages) == {each for name in brought for each in every[name]}
    assert {"pillow", "scikit-image", "pytest"} < {name.lower() for name in found.packages}


def test_a_folder_without_a_file_of_its_own_is_gone_through(folder: Path) -> None:
    (folder / "methods/bare/deep").mkdir(parents=True)
    (folder / "methods/bare/deep/end.py").write_text("end = 4\n")
    (folder / "methods/unused.py").write_text("from methods.bare.deep.end import end\n")

    found = SourceTree.below(folder).digest(["methods.unused"])

    assert set(found.modules) == {"methods", "methods.unused", "methods.bare.deep.end"}


def test_what_has_no_source_is_told(folder: Path) -> None:
    with pytest.raises(HarnessError, match=r"no source of the module 'methods\.absent'"):
        SourceTree.below(folder).digest(["methods.absent"])
    with pytest.raises(HarnessError, match="source of the package 'absent_package'"):
        SourceTree.installed("absent_package.method")
    (folder / "methods/unused.py").write_text("def (")
    with pytest.raises(HarnessError, match=r"unused\.py is no Python module"):
        SourceTree.below(folder).digest(["methods.unused"])


def test_a_file_is_parsed_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = SourceTree.below(folder)
    first = tree.digest(["methods.one"])

    def parsed_again(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(module_source.ast, "parse", parsed_again)
    assert tree.digest(["methods.one"]) == first
