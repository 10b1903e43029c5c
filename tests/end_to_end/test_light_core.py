"""The light core on the newest Python: it installs by itself, is small, and scores the same."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.data.manifest import load_manifest
from harness.files.mesh_files import save_mesh

ROOT = Path(__file__).parents[2]
PYENV = ".pyenv/versions/3.13.*/bin/python3.13"
MOST_GB = 1.2
pytestmark = pytest.mark.nightly


def _answers(python: str) -> bool:
    return not subprocess.run([python, "--version"], capture_output=True, check=False).returncode


@pytest.fixture(scope="module")
def newer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scripts of an environment of Python 3.13 into which the bench was installed."""
    known = [shutil.which("python3.13") or "", *map(str, Path.home().glob(PYENV))]
    # A command of pyenv's is there for versions that are not chosen, too.
    python = next((name for name in known if name and _answers(name)), None)
    if python is None:
        pytest.skip("Python 3.13 is not here")
    place = tmp_path_factory.mktemp("newer") / "venv"
    subprocess.run([python, "-m", "venv", str(place)], check=True)
    pip = [str(place / "bin" / "pip"), "install", "-q", "-c", str(ROOT / "constraints.txt")]
    subprocess.run([*pip, str(ROOT)], check=True)
    return place / "bin"


@pytest.fixture(scope="module")
def meshes(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A closed surface with bumps, and the same a little off."""
    folder = tmp_path_factory.mktemp("meshes")
    rows, columns = 60, 90
    polar, around = np.meshgrid(
        np.linspace(0.02, np.pi - 0.02, rows), np.arange(columns) * 2 * np.pi / columns,
        indexing="ij",
    )  # fmt: skip
    radius = 0.5 + 0.03 * np.sin(7 * around) * np.sin(polar) ** 2
    points = np.stack(
        [np.sin(polar) * np.sin(around), 1.7 * np.cos(polar), np.sin(polar) * np.cos(around)], -1
    )
    poles = [[0, 0.85, 0], [0, -0.85, 0]]
    points = np.concatenate([(radius[..., None] * points).reshape(-1, 3), poles])
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    top, low = (np.full(columns, len(points) - k) for k in (2, 1))
    caps = ((top, a[0], d[0]), (low, c[-1], b[-1]))
    faces = np.concatenate(
        [
            *(np.stack(corners, -1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))),
            *(np.stack(corners, -1) for corners in caps),
        ]
    )
    rng = np.random.default_rng(0)
    save_mesh(folder / "truth.ply", Mesh(points, faces))
    save_mesh(folder / "mesh.ply", Mesh(points + rng.normal(0, 0.004, points.shape), faces))
    return folder / "mesh.ply", folder / "truth.ply"


def numbers(value: object, place: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for key, each in value.items():
            yield from numbers(each, f"{place}.{key}")
    elif isinstance(value, list):
        for number, each in enumerate(value):
            yield from numbers(each, f"{place}[{number}]")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield place, float(value)


def test_it_is_small(newer: Path) -> None:
    files = [path for path in newer.parent.rglob("*") if path.is_file() and not path.is_symlink()]
    assert sum(path.stat().st_size for path in files) < MOST_GB * 1e9


@pytest.mark.parametrize("protocol", list(load_manifest(ROOT / "data_manifest.yaml").protocols))
def test_scores_are_those_of_this_python(
    newer: Path, meshes: tuple[Path, Path], protocol: str, tmp_path: Path
) -> None:
    mesh, truth = map(str, meshes)
    command = ["score", mesh, "--gt", truth, "--protocol", protocol, "--json"]
    environment = {**os.environ, "HARNESS_MANIFEST": str(ROOT / "data_manifest.yaml")}
    found = []
    for harness in ([str(newer / "harness")], [sys.executable, "-m", "harness.cli.main"]):
        done = subprocess.run(
            [*harness, *command],
            cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        found.append(dict(numbers(json.loads(done.stdout))))
    new, old = found
    assert new.keys() == old.keys()
    assert len(old) > 4
    assert {
        name: (value, old[name])
        for name, value in new.items()
        if not math.isclose(value, old[name], rel_tol=1e-12, abs_tol=1e-12)
    } == {}
