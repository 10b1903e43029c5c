"""Surfaces whose distances are known in closed form, and a small figure to turn about."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.core.settings import MetricProtocol


def subdivided(mesh: Mesh, times: int = 1) -> Mesh:
    """Each triangle cut into four, on the same surface."""
    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(times):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, of_corner = np.unique(edges, axis=0, return_inverse=True)
        ab, bc, ca = (of_corner.reshape(-1, 3) + len(vertices)).T
        vertices = np.vstack([vertices, vertices[unique].mean(axis=1)])
        a, b, c = faces.T
        corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(triangle, axis=1) for triangle in corners])
    return Mesh(vertices=vertices, faces=faces, source=mesh.source)


def sphere(radius: float = 1.0, centre=(0.0, 0.0, 0.0), level: int = 5) -> Mesh:
    octahedron = Mesh(
        vertices=np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]]),
        faces=np.array(
            [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
        ),
    )
    mesh = octahedron
    for _ in range(level):
        mesh = subdivided(mesh)
        lengths = np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
        mesh = Mesh(vertices=mesh.vertices / lengths, faces=mesh.faces, source="sphere")
    return Mesh(vertices=mesh.vertices * radius + centre, faces=mesh.faces, source="sphere")


def square(side: float = 1.0, level: int = 4) -> Mesh:
    """In the plane z = 0, centred, facing +z."""
    half = side / 2
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return subdivided(Mesh(vertices=corners, faces=faces, source="square"), level)


def box(low, high, level: int = 0) -> Mesh:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[q[i], q[j], q[k]] for q in quads for i, j, k in ((0, 1, 2), (0, 2, 3))])
    low, high = np.asarray(low, float), np.asarray(high, float)
    return subdivided(Mesh(vertices=low + corners * (high - low), faces=faces, source="box"), level)


def joined(*meshes: Mesh, source: str = "figure") -> Mesh:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        vertices=np.vstack([mesh.vertices for mesh in meshes]),
        faces=np.vstack([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]),
        source=source,
    )


def figure(source: str = "figure") -> Mesh:
    """A person of boxes, 1.76 m high, one arm to the side and one to the front."""
    parts = joined(
        box([-0.09, 1.5, -0.1], [0.09, 1.76, 0.1]),
        box([-0.18, 0.85, -0.12], [0.18, 1.5, 0.12]),
        box([-0.17, 0.0, -0.08], [-0.02, 0.85, 0.08]),
        box([0.02, 0.0, -0.08], [0.17, 0.85, 0.08]),
        box([0.02, 0.0, 0.08], [0.14, 0.08, 0.2]),
        box([-0.14, 0.0, 0.08], [-0.02, 0.08, 0.2]),
        box([0.18, 1.35, -0.05], [0.75, 1.46, 0.05]),
        box([-0.29, 1.3, -0.05], [-0.18, 1.42, 0.45]),
        source=source,
    )
    centre = (parts.vertices.min(axis=0) + parts.vertices.max(axis=0)) / 2
    return subdivided(Mesh(vertices=parts.vertices - centre, faces=parts.faces, source=source), 2)


def moved(mesh: Mesh, offset=(0.0, 0.0, 0.0), matrix=((1, 0, 0), (0, 1, 0), (0, 0, 1))) -> Mesh:
    vertices = mesh.vertices @ np.asarray(matrix, float).T + np.asarray(offset, float)
    return Mesh(vertices=vertices, faces=mesh.faces, source=mesh.source)


def flipped(mesh: Mesh) -> Mesh:
    return Mesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1], source=mesh.source)


def rotation(axis: int, degrees: float) -> np.ndarray:
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix[[first, first, second, second], [first, second, first, second]] = cos, -sin, sin, cos
    return matrix


@pytest.fixture(scope="session")
def shapes() -> SimpleNamespace:
    makers = (subdivided, sphere, square, box, joined, figure, moved, flipped, rotation)
    return SimpleNamespace(**{maker.__name__: maker for maker in makers})


@pytest.fixture(scope="session")
def mexecon() -> MetricProtocol:
    """As shipped."""
    return MetricProtocol(
        *("mexecon", 2, 30_000, "independent", "sample-to-sample"),
        normal_weights="permuted",
        texture_seams="split",
        cancelled_normals="left-out",
    )


@pytest.fixture(scope="session")
def exact() -> MetricProtocol:
    return MetricProtocol("exact", 1, 50_000, "stratified", "point-to-surface")
