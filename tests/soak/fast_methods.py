"""A package of many fast methods, for soaks: a cell takes a fraction of a second.

Cells are worked on within the process that plans them, by the code that a worker runs. What a soak
is about, tasks, locks, records and their publication, is as always.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.artifacts import Capture, Reconstruction
from harness.core.files.hashing import derive_seed
from harness.core.mesh import Mesh
from harness.core.process.workers import run_worker
from harness.core.protocols import Context, MethodInfo
from harness.run import evaluate

_CELL_WORKER = "harness.run.cell_worker"
_CORNERS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
_FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
)


class Octahedron:
    """A method whose result depends on its name, the subject and the seed, and on nothing else."""

    def __init__(self, name: str) -> None:
        self.info = MethodInfo(name, f"Octahedron {name}")

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        dice = np.random.default_rng(derive_seed(context.seed, self.info.name, capture.subject))
        with context.stage("make"):
            radii_m = dice.uniform(0.1, 0.9, 3)
            mesh = Mesh(_CORNERS * radii_m + [0.0, 0.8, 0.0], _FACES)
        return Reconstruction(mesh)


def __getattr__(name: str) -> Octahedron:
    """``fast_methods.fast0007``: one of as many methods as a package names."""
    if name.startswith("fast"):
        return Octahedron(name)
    raise AttributeError(name)


def _here(module: str, job: Mapping[str, object], **more: Any) -> dict[str, Any]:
    if module != _CELL_WORKER:
        return run_worker(module, job, **more)
    worker = importlib.import_module(module)
    return json.loads(json.dumps(worker.handle(json.loads(json.dumps(job)), lambda *_: None)))


evaluate.run_worker = _here


def write_package(folder: Path, count: int) -> tuple[str, ...]:
    """A package in a folder of the module path that brings ``count`` methods; their names."""
    names = tuple(f"fast{number:04d}" for number in range(count))
    about = folder / "fast_methods-1.dist-info"
    about.mkdir(parents=True)
    (folder / "fast_methods.py").write_text(Path(__file__).read_text())
    # Open3D imports Dash for its plots, which no command makes: a third of a second a process.
    (folder / "dash.py").write_text("html = dcc = Dash = None\n")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: fast-methods\nVersion: 1\n")
    entries = "\n".join(f"{name} = fast_methods:{name}" for name in names)
    (about / "entry_points.txt").write_text(f"[harness.methods]\n{entries}\n")
    return names
