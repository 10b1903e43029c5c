"""ruff and pyright are clean on the tree, and their rules bite."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent


def ruff(*arguments: str, text: str | None = None) -> subprocess.CompletedProcess[str]:
    command = [str(BIN / "ruff"), *arguments]
    return subprocess.run(
        command, cwd=ROOT, input=text, capture_output=True, text=True, check=False
    )


def test_ruff_is_clean() -> None:
    done = ruff("check", "--no-cache", "--output-format", "concise", ".")

    assert done.returncode == 0, done.stdout + done.stderr


def test_ruff_format_is_clean() -> None:
    done = ruff("format", "--no-cache", "--check", ".")

    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("rule", "source"),
    [
        ("ANN201", "def public(): ...\n"),
        ("BLE001", "try:\n    pass\nexcept Exception:\n    x = 1\n"),
        ("D103", "def public() -> None: ...\n"),
        ("E501", f"x = '{'x' * 100}'\n"),
        ("F401", "import json\n"),
        ("NPY002", "import numpy as np\nnp.random.rand(3)\n"),
        ("PLR0913", "def f(a, b, c, d, e, f, g): ...\n"),
        ("S110", "try:\n    x = 1\nexcept Exception:\n    pass\n"),
        ("S307", "eval('1')\n"),
        ("T201", "print(1)\n"),
        ("TID251", "import numpy as np\nnp.random.seed(0)\n"),
        ("TID251", "import pickle\npickle.load(stream)\n"),
        ("C901", "def f(x):\n" + "".join(f"    if x == {i}:\n        x = 0\n" for i in range(11))),
    ],
)
def test_a_ruff_rule_bites(rule: str, source: str) -> None:
    arguments = ["check", "--no-cache", "--output-format", "json"]
    done = ruff(*arguments, "--stdin-filename", "metrics/planted.py", "-", text=source)

    assert rule in {finding["code"] for finding in json.loads(done.stdout)}


def test_every_ignored_rule_says_why() -> None:
    section = (ROOT / "pyproject.toml").read_text().split("[tool.ruff.lint]")[1]
    ignored = section.split("ignore = [")[1].split("\n]")[0].strip().splitlines()

    assert [line for line in ignored if "  # " not in line] == []


def pyright(folder: Path) -> dict:
    command = [str(BIN / "pyright"), "--outputjson", "--pythonpath", sys.executable]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=300
    )
    return json.loads(done.stdout)


@pytest.mark.nightly
def test_pyright_is_clean_where_it_is_strict_and_bites_there(tmp_path: Path) -> None:
    """On a copy of ``harness/core``, once as it is and once with a planted hole."""
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "harness" / "core", tmp_path / "harness" / "core", ignore=ignore)
    shutil.copy(ROOT / "harness" / "__init__.py", tmp_path / "harness")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    planted = tmp_path / "harness" / "core" / "planted.py"
    planted.write_text("def hole(value):\n    return value\n")

    report = pyright(tmp_path)

    errors = [entry for entry in report["generalDiagnostics"] if entry["severity"] == "error"]
    found = {(Path(entry["file"]).name, entry.get("rule")) for entry in errors}
    assert ("planted.py", "reportMissingParameterType") in found
    assert [entry for entry in errors if Path(entry["file"]) != planted] == []
