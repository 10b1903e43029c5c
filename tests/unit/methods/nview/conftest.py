"""Views of shapes with known surfaces: exact outlines, exact normals."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from skimage.measure import marching_cubes

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.raycast import Raycaster
from methods.nview.views import FusionView, NormalTargets, fusion_view

#: Distance of a shape's surface from points (N, 3), metres, positive inside.
Inside = Callable[[Floats], Floats]


def _shape(inside: Inside, half: float, step: float) -> Mesh:
    """The outward surface of a closed-form shape that fits a cube, on a fine lattice."""
    axis = np.arange(-half, half + step, step) + 0.37 * step
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    field = inside(points.reshape(-1, 3)).reshape(points.shape[:3])
    vertices, faces, _, _ = marching_cubes(field.astype(np.float32), 0.0, spacing=(step,) * 3)
    mesh = Mesh(vertices.astype(np.float64) + axis[0], faces)
    return mesh if mesh.signed_volume > 0 else Mesh(mesh.vertices, faces[:, ::-1])


def _views_of(
    mesh: Mesh,
    cameras: Sequence[Camera],
    *,
    normals: Callable[[Floats], Floats] = lambda maps: maps,
    coverage: Callable[[int, Floats], Floats] = lambda _, share: share,
) -> list[FusionView]:
    """The views of a mesh: what it covers, and its normals, each changed if wanted."""
    caster = Raycaster(mesh)
    return [
        fusion_view(
            index,
            camera,
            coverage(index, caster.coverage(camera)),
            NormalTargets(
                camera, normals(caster.normals(camera, frame="world")).astype(np.float32)
            ),
        )
        for index, camera in enumerate(cameras)
    ]


def _ring(views: int = 8, **changes: float) -> tuple[Camera, ...]:
    """Cameras around the origin, near enough for pixels of 2 mm."""
    return RingRig(views=views, radius_m=1.5, **changes).cameras(360, 480)


@pytest.fixture(scope="session")
def shape():
    """``shape(inside, half, step)``: the outward surface of a closed-form shape."""
    return _shape


@pytest.fixture(scope="session")
def views_of(ball):
    """``views_of(mesh, cameras, normals=..., coverage=...)``: exact views, changed if wanted.

    Those of the ball from a few cameras are made once.
    """
    known: dict[bytes, list[FusionView]] = {}

    def views(mesh: Mesh, cameras: Sequence[Camera], **changes) -> list[FusionView]:
        if mesh is not ball or changes or len(cameras) > 8:
            return _views_of(mesh, cameras, **changes)
        key = pickle.dumps(tuple(cameras))
        if key not in known:
            known[key] = _views_of(mesh, cameras)
        return list(known[key])

    return views


@pytest.fixture(scope="session")
def ring():
    """``ring(views, ...)``: cameras around the origin, near enough for pixels of 2 mm."""
    return _ring


@pytest.fixture(scope="session")
def ball() -> Mesh:
    """A sphere of 20 cm."""
    return _shape(lambda p: 0.2 - np.linalg.norm(p, axis=1), 0.22, 0.005)
