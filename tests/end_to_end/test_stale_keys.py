"""One changed line in a module that a record depends on makes it stale; in another it does not."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PACKAGES = ("harness", "renderers", "methods", "metrics", "reports")
USED = {
    "methods/hull.py": "changed: code of methods.hull",
    "metrics/distance.py": "changed: code of metrics.distance",
    "metrics/regions.py": "changed: code of metrics.regions",
    "harness/run/cell.py": "changed: code of harness.run.cell",
    "harness/core/protocols.py": "changed: code of harness.core.protocols",
    "renderers/raycast.py": "photos stale: changed: code of renderers.raycast",
    "harness/files/obj.py": "photos stale: changed: code of harness.files.obj",
}
UNUSED = (
    "methods/body/fit/jmbo.py",
    "methods/clothed.py",
    "methods/gt.py", "methods/catalog.py", "reports/formats/latex.py",
    "harness/cli/report.py",
    "harness/run/body_scores.py", "harness/run/normal_scores.py",
    "harness/run/plan.py", "harness/data/manifest.py", "renderers/blender/scene.py",
    "renderers/proof.py",
)  # fmt: skip


@pytest.fixture
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of all packages, to be changed."""
    folder = tmp_path_factory.mktemp("source")
    for package in PACKAGES:
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, folder / package, ignore=ignore)
    return folder


@pytest.fixture
def plan(world: Path, source: Path) -> Callable[..., str]:
    """``plan()``: what ``harness eval --dry-run`` of the copy says; ``plan(run=True)`` runs it."""

    def evaluate(*, run: bool = False) -> str:
        command = [
            sys.executable, "-m", "harness.cli.main", "eval", "--dataset", "toy", "--recipe",
            "tiny", "--method", "hull8", "--subjects", "t1", "--set", "hull.voxel_m=0.02",
            *([] if run else ["--dry-run"]),
        ]  # fmt: skip
        done = subprocess.run(
            command, cwd=world, capture_output=True, text=True, timeout=300, check=True,
            env={**os.environ, "PYTHONPATH": str(source)},
        )  # fmt: skip
        return done.stdout

    return evaluate


@pytest.mark.usefixtures("photographed")
def test_a_line_in_a_used_module_and_in_an_unused_one(source, plan):
    plan(run=True)
    assert "cached" in plan()

    for name in UNUSED:
        path = source / name
        path.write_text(f"{path.read_text()}\n_A_NEW_LINE = 1\n")
    for name in USED:
        path = source / name
        path.write_text(f"{path.read_text()}\n# A comment.\n")
    assert "cached" in plan(), "unused modules and comments"

    for name, told in USED.items():
        path = source / name
        before = path.read_text()
        path.write_text(f"{before}\n_A_NEW_LINE = 1\n")
        found = plan()
        assert f"run     {told}\n" in found, name
        path.write_text(before)
    assert "cached" in plan(), "what is taken back is as before"
