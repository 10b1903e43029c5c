"""Round things with known normals, and a photo of one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, image_name
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster


@pytest.fixture(scope="session")
def sphere() -> Callable[..., Mesh]:
    """``sphere(radius, centre)``: fine, closed, outward, with vertices on the sphere."""

    def build(radius: float = 0.4, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
        rings, segments = 120, 160
        polar = np.linspace(0, np.pi, rings + 1)[1:-1]
        around = np.arange(segments) * 2 * np.pi / segments
        v, u = np.meshgrid(polar, around, indexing="ij")
        ring = np.stack([np.sin(v) * np.sin(u), np.cos(v), np.sin(v) * np.cos(u)], axis=-1)
        points = np.concatenate([ring.reshape(-1, 3), [[0, 1, 0], [0, -1, 0]]])
        index = np.arange((rings - 1) * segments).reshape(rings - 1, segments)
        right = np.roll(index, -1, axis=1)
        a, b, c, d = (part.ravel() for part in (index[:-1], index[1:], right[1:], right[:-1]))
        top, low = len(points) - 2, len(points) - 1
        caps = [
            np.stack([np.full(segments, top), index[0], right[0]], axis=1),
            np.stack([np.full(segments, low), right[-1], index[-1]], axis=1),
        ]
        faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), *caps])
        return Mesh(points * radius + centre, faces)

    return build


@pytest.fixture(scope="session")
def cameras() -> tuple[Camera, ...]:
    """Eight cameras around the origin at 3 m, portrait, small."""
    return RingRig().cameras(270, 480)


@pytest.fixture
def photograph(tmp_path: Path, cameras) -> Callable[[Mesh], Capture]:
    """``photograph(mesh)``: views 0 and 1 of it, red on the left half of the picture, else blue."""

    def take(mesh: Mesh) -> Capture:
        caster = Raycaster(mesh)
        for view, camera in enumerate(cameras[:2]):
            alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
            colour = np.zeros((*alpha.shape, 3), np.uint8)
            colour[:, : camera.width // 2, 0] = 255
            colour[:, camera.width // 2 :, 2] = 255
            save_png(tmp_path / image_name(view), np.dstack([colour, alpha]))
        return Capture("toy", "ball", "tiny", "key", tmp_path, cameras[:2])

    return take
