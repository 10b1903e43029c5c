"""A round body and cameras for closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.camera import Camera, look_at


def _sphere(radius: float = 0.5, rings: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward faces of a closed ball at the origin."""
    polar = np.linspace(0, np.pi, rings + 1)[1:-1]
    around = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    theta, phi = np.meshgrid(polar, around, indexing="ij")
    points = np.stack(
        [np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1
    ).reshape(-1, 3)
    vertices = radius * np.concatenate([points, [[0, 1, 0], [0, -1, 0]]])
    columns, rows = 2 * rings, rings - 1
    faces = []
    for i in range(rows - 1):
        for j in range(columns):
            a, b = i * columns + j, i * columns + (j + 1) % columns
            faces += [(a, a + columns, b), (b, a + columns, b + columns)]
    top, bottom = len(points), len(points) + 1
    for j in range(columns):
        k = (j + 1) % columns
        faces += [(top, j, k), (bottom, (rows - 1) * columns + k, (rows - 1) * columns + j)]
    return vertices, np.array(faces)


@pytest.fixture(name="ball", scope="session")
def _ball() -> tuple[np.ndarray, np.ndarray]:
    return _sphere()


def _pitched_camera(pitch_deg: float = 30.0, yaw_deg: float = 20.0, size: int = 240) -> Camera:
    """Looks at the origin from 3 m away and above, square picture."""
    pitch, yaw = np.radians(pitch_deg), np.radians(yaw_deg)
    direction = [np.cos(pitch) * np.sin(yaw), np.sin(pitch), np.cos(pitch) * np.cos(yaw)]
    K = np.array([[2.0 * size, 0, size / 2], [0, 2.0 * size, size / 2], [0, 0, 1]])
    return Camera(K, look_at(3.0 * np.array(direction), np.zeros(3)), size, size)


@pytest.fixture(name="camera")
def _camera() -> Camera:
    return _pitched_camera()


@pytest.fixture(name="pitched_camera", scope="session")
def _pitched_cameras():
    return _pitched_camera


@pytest.fixture(name="sphere", scope="session")
def _spheres():
    return _sphere
