"""A sphere, a box and photos of them that are masks alone; depth and normals are known."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, image_name
from harness.core.mesh import Mesh
from harness.core.protocols import Context
from harness.core.rigs import RingRig
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster

RADIUS_M = 0.5
CENTRE_M = np.array([0.05, 0.1, -0.02])


def sphere(radius: float = RADIUS_M, centre: np.ndarray = CENTRE_M, rows: int = 96) -> Mesh:
    """A closed sphere of latitudes and longitudes, faces outwards."""
    polar = np.linspace(0, np.pi, rows + 1)[1:-1]
    around = np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False)
    grid = np.stack(
        [
            np.outer(np.sin(polar), np.sin(around)),
            np.outer(np.cos(polar), np.ones_like(around)),
            np.outer(np.sin(polar), np.cos(around)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    vertices = np.concatenate([grid, [[0, 1, 0], [0, -1, 0]]])
    count, width = len(polar), len(around)
    index = np.arange(count * width).reshape(count, width)
    a, b = index[:-1], np.roll(index[:-1], -1, axis=1)
    c, d = index[1:], np.roll(index[1:], -1, axis=1)
    quads = [np.stack([a, c, b], -1).reshape(-1, 3), np.stack([b, c, d], -1).reshape(-1, 3)]
    top, bottom = count * width, count * width + 1
    first, last = index[0], index[-1]
    caps = [
        np.stack([np.full(width, top), first, np.roll(first, -1)], -1),
        np.stack([np.full(width, bottom), np.roll(last, -1), last], -1),
    ]
    return Mesh(radius * vertices + centre, np.concatenate([*quads, *caps]), source="sphere")


def captured(mesh: Mesh, folder: Path, rig: RingRig, size: tuple[int, int]) -> Capture:
    cameras = rig.cameras(*size)
    caster = Raycaster(mesh)
    for view, camera in enumerate(cameras):
        alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
        grey = np.full((*alpha.shape, 3), 180, np.uint8)
        save_png(folder / image_name(view), np.dstack([grey, alpha]))
    return Capture("toy", "sphere", "tiny", "key", folder, cameras)


@pytest.fixture(scope="session")
def ball() -> Mesh:
    return sphere()


@pytest.fixture(scope="session")
def capture(ball, tmp_path_factory) -> Capture:
    return captured(ball, tmp_path_factory.mktemp("ball"), RingRig(), (270, 480))


@pytest.fixture
def context(ball, tmp_path) -> Context:
    return Context(
        seed=7,
        workdir=tmp_path,
        stage=lambda _: contextlib.nullcontext(),
        privileged={"ground_truth_mesh": ball},
    )
