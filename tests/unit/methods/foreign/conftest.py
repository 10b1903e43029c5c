"""Photos of a ball, a method's folder, and an interpreter with numpy and nothing of ours."""

from __future__ import annotations

import contextlib
import venv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, image_name
from harness.core.protocols import Context
from harness.core.rigs import RingRig
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from tests.spheres import icosphere
from tests.unit.methods.foreign.toys import MIDDLE, RADIUS, TOY


def made_interpreter(folder: Path) -> Path:
    """A virtual environment with the numpy of this one; returns its program."""
    venv.EnvBuilder(symlinks=True, with_pip=False).create(folder)
    (site,) = folder.glob("lib/python3*/site-packages")
    beside = Path(np.__file__).parents[1]
    (about,) = (path.name for path in beside.glob("numpy-*.dist-info"))
    for name in ("numpy", "numpy.libs", about):
        if (beside / name).exists():
            (site / name).symlink_to(beside / name)
    return folder / "bin" / "python"


@pytest.fixture(scope="session")
def other_python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its program."""
    return made_interpreter(tmp_path_factory.mktemp("other") / "python")


@pytest.fixture(scope="session")
def make_interpreter() -> Callable[[Path], Path]:
    """``make_interpreter(folder)``: one of its own."""
    return made_interpreter


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    """Eight small photos of the ball."""
    folder = tmp_path_factory.mktemp("capture")
    cameras = RingRig().cameras(90, 160)
    ball = icosphere(RADIUS)
    caster = Raycaster(replace(ball, vertices=ball.vertices + MIDDLE))
    for view, camera in enumerate(cameras):
        alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
        picture = np.dstack([np.full((*alpha.shape, 3), 200, np.uint8), alpha])
        save_png(folder / image_name(view), picture)
    return Capture("toy", "s", "r", "k", folder, cameras)


@pytest.fixture
def context(tmp_path) -> Context:
    return Context(
        7, tmp_path / "work", lambda _: contextlib.nullcontext(), {"subject_centre": np.arange(3.0)}
    )


@pytest.fixture
def folder(tmp_path) -> Path:
    place = tmp_path / "method"
    place.mkdir()
    (place / "run.py").write_text(TOY)
    return place
