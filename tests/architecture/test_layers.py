"""The floors hold, and each contract bites when its violation is planted."""

from __future__ import annotations

import ast
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("harness", "renderers", "methods", "metrics", "reports")
PACKAGES_BESIDE = sorted(path.parent for path in ROOT.glob("packages/*/*/__init__.py"))
CONFIG = tomllib.loads((ROOT / "pyproject.toml").read_text())
CONTRACTS = [contract["name"] for contract in CONFIG["tool"]["importlinter"]["contracts"]]

(
    FLOORS, CLOSED, ROOMS, FIT, AVATARS, REPORTS, EMPTY, DOOR, LIGHT, BLENDER, FOUND, OWN,
    TRAINING, ASKED,
) = CONTRACTS  # fmt: skip

#: A contract, the file that breaks it, and the line that does.
PLANTS = [
    (FLOORS, "harness/core/metric_catalog.py", "import harness.geometry"),
    (FLOORS, "harness/geometry/window.py", "import metrics"),
    (FLOORS, "methods/gt.py", "import harness.data"),
    (FLOORS, "methods/gt.py", "import metrics"),
    (FLOORS, "reports/formats/programs.py", "import renderers"),
    (FLOORS, "metrics/distance.py", "def later():\n    import harness.run.plan"),
    (FLOORS, "harness/run/plan.py", "import harness.cli"),
    (CLOSED, "harness/stray.py", ""),
    (FLOORS, "harness/run/plan.py", "import harness.report.tables"),
    (ROOMS, "methods/body/photos/views.py", "import methods.normals.onnx_estimator"),
    (ROOMS, "methods/normals/onnx_estimator.py", "import methods.surface.fusion"),
    (ROOMS, "methods/surface/completion.py", "def later():\n    import methods.body.models.model"),
    (ROOMS, "methods/surface/fusion.py", "import methods.clothed"),
    (ROOMS, "methods/clothed.py", "import methods.mexecon"),
    (ROOMS, "methods/parts/kind.py", "import methods.body.settings"),
    (ROOMS, "methods/parts/converted.py", "import methods.surface.fusion"),
    (ROOMS, "methods/closed/lattices.py", "import methods.surface.fusion"),
    (ROOMS, "methods/masks.py", "import methods.normals.onnx_estimator"),
    (FIT, "methods/body/models/model.py", "import methods.body.photos.views"),
    (FIT, "methods/body/photos/views.py", "import methods.body.fit.evidence"),
    (FIT, "methods/body/stray.py", ""),
    (AVATARS, "clothed_avatars/skin/paint.py", "import clothed_avatars.recipe"),
    (AVATARS, "clothed_avatars/clothes/layer.py", "import clothed_avatars.skin.hair"),
    (AVATARS, "clothed_avatars/people/poses.py", "import clothed_avatars.clothes.looks"),
    (AVATARS, "clothed_avatars/mesh/noise.py", "import clothed_avatars.people.body"),
    (AVATARS, "clothed_avatars/stray.py", ""),
    (REPORTS, "reports/tables/cost.py", "import reports.formats.latex"),
    (REPORTS, "reports/figures/panels.py", "import reports.regression.compare"),
    (REPORTS, "reports/statistics.py", "import reports.tables.table"),
    (EMPTY, "harness/__init__.py", "import harness.core.metric_catalog"),
    (DOOR, "methods/gt.py", "from harness import load_manifest"),
    (LIGHT, "harness/core/metric_catalog.py", "import torch"),
    (LIGHT, "harness/core/mesh.py", "def later():\n    import scipy.spatial"),
    (BLENDER, "methods/hull.py", "import bpy"),
    (BLENDER, "renderers/protocol.py", "def later():\n    import mathutils"),
    (FOUND, "harness/data/generators.py", "import clothed_avatars.build"),
    (OWN, "clothed_avatars/generator.py", "import metrics"),
    (TRAINING, "normal_training/learning/loop.py", "import normal_training.training_runs"),
    (TRAINING, "normal_training/stray.py", ""),
    (ASKED, "normal_training/train_normals.py", "import clothed_avatars.recipe"),
]

#: A line that breaks nothing; checked last, it shows that no plant is left over.
UNPLANTED = ("harness/core/metric_catalog.py", "# nothing")

#: Checks the contracts of the working folder once for every planted line, without a new start.
EVERY_PLANT = """
import contextlib, io, json, sys
from pathlib import Path
from importlinter.cli import lint_imports

found = []
for file, line in json.load(sys.stdin):
    path = Path(file)
    original = path.read_text() if path.exists() else None
    path.write_text(f"{original or ''}\\n{line}\\n")
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        code = lint_imports(no_cache=True)
    found.append((output.getvalue(), code))
    path.unlink() if original is None else path.write_text(original)
json.dump(found, sys.stdout)
"""


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def verdicts(output: str) -> dict[str, str]:
    found = {
        name: re.search(rf"^{re.escape(name)} (KEPT|BROKEN)", output, re.MULTILINE)
        for name in CONTRACTS
    }
    return {name: match[1] if match else "not run" for name, match in found.items()}


def test_every_contract_is_kept() -> None:
    done = lint_imports(ROOT)

    assert verdicts(done.stdout) == dict.fromkeys(CONTRACTS, "KEPT"), done.stdout + done.stderr
    assert done.returncode == 0


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tree")
    for package in PACKAGES:
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, folder / package, ignore=ignore)
    for package in PACKAGES_BESIDE:
        shutil.copytree(package, folder / package.name, ignore=ignore)
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


@pytest.fixture(scope="module")
def planted(copy: Path) -> dict[tuple[str, str], tuple[str, int]]:
    """Output and exit code of the contracts' check by file and planted line, and of none."""
    plants = [(file, line) for _, file, line in PLANTS]
    done = subprocess.run(
        [sys.executable, "-c", EVERY_PLANT],
        cwd=copy,
        input=json.dumps([*plants, UNPLANTED]),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return dict(zip([*plants, UNPLANTED], map(tuple, json.loads(done.stdout)), strict=True))


def test_without_a_plant_every_contract_of_the_copy_is_kept(planted) -> None:
    output, code = planted[UNPLANTED]
    assert verdicts(output) == dict.fromkeys(CONTRACTS, "KEPT"), output
    assert code == 0


@pytest.mark.parametrize(
    ("contract", "file", "line"), PLANTS, ids=[f"{file} {line}" for _, file, line in PLANTS]
)
def test_a_planted_violation_breaks_its_contract(
    planted, contract: str, file: str, line: str
) -> None:
    output, code = planted[file, line]

    assert verdicts(output)[contract] == "BROKEN", output
    assert code == 1


def test_every_contract_has_a_planted_violation() -> None:
    assert {contract for contract, *_ in PLANTS} == set(CONTRACTS)


def imports_blender(source: str) -> bool:
    """Whether a module imports Blender's packages anywhere, by statement or by name."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            names |= {str(arg.value) for arg in node.args if isinstance(arg, ast.Constant)}
    return any(name.split(".")[0] in ("bpy", "bmesh", "mathutils") for name in names)


def test_only_workers_import_blender() -> None:
    folders = [*(ROOT / package for package in PACKAGES), *PACKAGES_BESIDE]
    sources = [path for folder in folders for path in folder.rglob("*.py")]
    importing = {path for path in sources if imports_blender(path.read_text())}

    assert importing, "the renderer has a worker"
    assert {path.name for path in importing if not path.stem.endswith("worker")} == set()


@pytest.mark.parametrize(
    "source",
    [
        "import bpy",
        "from mathutils import Vector",
        "def f():\n    import bmesh.ops",
        "import importlib\nimportlib.import_module('bpy')",
    ],
)
def test_the_search_for_blender_bites(source: str) -> None:
    assert imports_blender(source)
    assert not imports_blender(source.replace("b", "c").replace("mathutils", "math"))
