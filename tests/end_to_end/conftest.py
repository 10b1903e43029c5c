"""A small world: three textured figures in THuman's layout, photographed by ray casting."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.core.files.atomic import exclusive_lock
from harness.core.mesh import Mesh
from harness.files.obj import write_obj
from tests.fork_server import ForkServer

MANIFEST = """\
schema: 1
datasets:
  toy:
    title: Toy figures
    kind: thuman
    licence: CC0-1.0
    root: scans
    scale: metres
    facing: "+z"
    subjects: [t1, t2, t3]
splits:
  toy-one: {dataset: toy, subjects: [t1]}
rigs:
  ring8: {views: 8, radius_m: 3.0, lens_mm: 50.0, sensor_mm: 36.0}
recipes:
  tiny: {rig: ring8, width: 108, height: 192, renderer: raycast, minimum_mask_iou: 0.95}
protocols:
  mexecon: {version: 1, samples: 2000, sampling: independent, chamfer: sample-to-sample}
  exact: {version: 1, samples: 2000, sampling: stratified, chamfer: point-to-surface}
"""


#: Settings hold for every method of a command and ``gt`` has none: a visual hull that is quickly
#: made needs a name of its own to be evaluated beside it.
COARSE = """
from dataclasses import replace
from methods.hull import VisualHull, hull8

_set = hull8.configured({"hull.voxel_m": "0.02"})
coarse = VisualHull(replace(_set.info, name="coarse"), _set.settings)
"""


def ellipsoid(centre: tuple[float, float, float], radii: tuple[float, float, float]) -> Mesh:
    """A closed ellipsoid of 2 x 12 x 8 triangles with texture coordinates."""
    rings, segments = 9, 13
    v, u = np.meshgrid(np.linspace(0, 1, rings), np.linspace(0, 1, segments), indexing="ij")
    polar, around = np.pi * v, 2 * np.pi * u
    points = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=-1
    )
    index = np.arange(rings * segments).reshape(rings, segments)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return Mesh(
        vertices=points.reshape(-1, 3) * radii + centre,
        faces=faces,
        uv=np.stack([u, 1 - v], axis=-1).reshape(-1, 2),
        face_uv=faces,
    )


def make_figure(height: float) -> Mesh:
    """A head, a trunk and four limbs, standing, ``height`` metres high."""
    parts = [
        ellipsoid((0, 0.92, 0), (0.07, 0.08, 0.08)),
        ellipsoid((0, 0.66, 0), (0.13, 0.2, 0.09)),
        ellipsoid((-0.2, 0.62, 0.02), (0.045, 0.2, 0.045)),
        ellipsoid((0.2, 0.62, 0.02), (0.045, 0.2, 0.045)),
        ellipsoid((-0.08, 0.25, 0), (0.06, 0.25, 0.06)),
        ellipsoid((0.08, 0.25, 0), (0.06, 0.25, 0.06)),
    ]
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, offsets, strict=True)])
    vertices = np.concatenate([part.vertices for part in parts]) * height
    uv = np.concatenate([part.uv for part in parts if part.uv is not None])
    return Mesh(vertices=vertices, faces=faces, uv=uv, face_uv=faces)


def put_subject(folder: Path, mesh: Mesh) -> None:
    """One subject in THuman's layout."""
    folder.mkdir(parents=True)
    write_obj(folder / f"{folder.name}.obj", mesh)
    (folder / "material0.mtl").write_text("newmtl material0\nmap_Kd material0.jpeg\n")
    ramp = np.linspace(60, 220, 64, dtype=np.uint8)
    pixels = np.stack(np.broadcast_arrays(ramp[:, None], ramp[None], np.uint8(120)), axis=-1)
    Image.fromarray(np.ascontiguousarray(pixels)).save(folder / "material0.jpeg")


def put_world(folder: Path) -> Path:
    """The toy dataset and its manifest in a folder, which is a workspace then."""
    (folder / "data_manifest.yaml").write_text(MANIFEST)
    for subject, height in (("t1", 1.6), ("t2", 1.7), ("t3", 1.8)):
        put_subject(folder / "scans" / "model" / subject, make_figure(height))
    return folder


@pytest.fixture
def world(tmp_path: Path) -> Path:
    """A workspace with the toy dataset and its manifest."""
    return put_world(tmp_path)


@pytest.fixture(scope="session")
def make_world() -> Callable[[Path], Path]:
    """``make_world(folder)``: a workspace with the toy dataset in an empty folder."""
    return put_world


@pytest.fixture
def figure() -> Callable[[float], Mesh]:
    """``figure(1.7)``: a person of that height."""
    return make_figure


@pytest.fixture
def write_subject() -> Callable[[Path, Mesh], None]:
    """``write_subject(folder, mesh)``: a scan in THuman's layout."""
    return put_subject


@pytest.fixture(scope="session")
def coarse_package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a package that brings the method ``coarse``."""
    folder = tmp_path_factory.mktemp("plugin")
    # Open3D imports Dash for its plots, which no command makes: a third of a second a process.
    (folder / "dash.py").write_text("html = dcc = Dash = None\n")
    (folder / "coarse_hull.py").write_text(COARSE)
    about = folder / "coarse_hull-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: coarse-hull\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[harness.methods]\ncoarse = coarse_hull:coarse\n")
    return folder


@pytest.fixture(autouse=True)
def coarse_hull(coarse_package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands that are run know the method ``coarse``."""
    monkeypatch.setenv("PYTHONPATH", str(coarse_package), prepend=os.pathsep)


Run = Callable[..., "subprocess.CompletedProcess[str]"]

#: What commands import, most of them anew each time, which is most of what they do.
IMPORTED = (
    "harness.cli.main",
    *(
        f"harness.cli.{verb}"
        for verb in ("check", "data", "evaluate", "render", "report", "results", "score")
    ),
    "matplotlib.figure",
    "pandas",
)


@pytest.fixture(scope="session")
def run_in() -> Iterator[Run]:
    """``run_in(folder, "eval", "--method", "gt")``, in a process of its own that starts at once."""
    server = ForkServer(IMPORTED)

    def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
        with tempfile.TemporaryDirectory() as place:
            output, errors = Path(place, "output"), Path(place, "errors")
            code = server.run(
                "harness.cli.main:main", arguments, folder=folder, output=output, errors=errors
            )
            return subprocess.CompletedProcess(
                arguments, code, output.read_text(), errors.read_text()
            )

    yield run
    server.close()


@pytest.fixture
def harness(world: Path, run_in: Run) -> Run:
    """``harness("eval", "--method", "gt")`` in the world, as a person would run it."""
    return lambda *arguments: run_in(world, *arguments)


EVAL = ("eval", "--dataset", "toy", "--recipe", "tiny")


@pytest.fixture(scope="session")
def finished_world(tmp_path_factory: pytest.TempPathFactory, run_in: Run) -> Path:
    """A world with all photos and all records of ``gt``, made once for all test processes."""
    place = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        place = place.parent
    finished = place / "finished-world"
    with exclusive_lock(place / "finished-world.lock"):
        if not finished.exists():
            begun = tmp_path_factory.mktemp("begun-world")
            done = run_in(put_world(begun), *EVAL, "--method", "gt", "--jobs", "2")
            assert done.returncode == 0, done.stderr
            begun.rename(finished)
    return finished


@pytest.fixture
def photographed(world: Path, finished_world: Path) -> None:
    """The world's photos are there already."""
    shutil.copytree(finished_world / "captures", world / "captures")


@pytest.fixture
def measured(world: Path, finished_world: Path, photographed: None) -> None:
    """The world's photos and its records of ``gt`` are there already."""
    shutil.copytree(finished_world / "runs", world / "runs", symlinks=True)


@pytest.fixture
def eval_toy(harness: Run) -> Run:
    """``eval_toy("hull8", ...)``: evaluate a method on the toy dataset."""
    return lambda method, *more: harness(*EVAL, "--method", method, *more)
