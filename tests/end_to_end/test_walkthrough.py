"""The reading order of ``harness/__init__.py`` is the way that one subject really travels."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import harness

ROOT = Path(harness.__file__).resolve().parents[1]

PROGRAM = """
import json, sys
from pathlib import Path
from harness.data.manifest import load_manifest
from harness.run.method_choice import chosen_methods
from harness.run.evaluate import evaluate
from harness.run.plan import EvalRequest
from harness.run.progress import Silent
from harness.report.tables import ReportRequest, build_table
from harness.run.sources import Source
from harness.run.store import RunStore
from harness.run.workspace import Workspace
import harness.core.process.workers, importlib

# The workers' steps in this process, so that the modules that they load can be seen.
def here(module, job, **_):
    return importlib.import_module(module).handle(job, lambda done, total: None)
for user in ("captures", "evaluate"):
    importlib.import_module(f"harness.run.{user}").run_worker = here

manifest = load_manifest()
workspace = Workspace(Path.cwd())
request = EvalRequest(
    source=Source.select(manifest, workspace, "toy-one", (), "tiny"),
    methods=chosen_methods(("hull8",), {}),
    protocol=manifest.protocol("mexecon"),
    store=RunStore(workspace.run("main")),
)
summary = evaluate(request, Silent())
cell = build_table(list(summary.records), ReportRequest(format="latex"))
print(json.dumps({"cell": cell, "modules": sorted(sys.modules)}))
"""


def reading_order() -> list[str]:
    return re.findall(r"^\d\. ``(.+?)``", harness.__doc__ or "", re.MULTILINE)


def test_every_module_names_its_neighbours():
    order = reading_order()
    assert len(order) == 8
    for index, name in enumerate(order):
        text = (ROOT / name).read_text()
        if index and name.endswith(".py"):
            assert f"Before: ``{order[index - 1]}``" in text, name
        if name.endswith(".py") and index + 1 < len(order):
            assert f"After: ``{order[index + 1]}``" in text, name


@pytest.mark.nightly
def test_one_subject_to_one_latex_cell(world):
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=world, capture_output=True, text=True, check=True
    )
    result = json.loads(run.stdout)
    row = next(
        line for line in result["cell"].splitlines() if line.strip().startswith("Visual hull")
    )
    assert re.search(r"& \\textbf\{\d+\.\d\d\} ", row), row
    travelled = {f"{module.replace('.', '/')}.py" for module in result["modules"]}
    # The toy world photographs by ray casting: Blender's scene is the one module it goes round.
    expected = {name for name in reading_order() if name.endswith(".py")}
    assert expected - {"renderers/blender/scene.py"} <= travelled
