"""The near and the far side of a mesh along one camera's rays, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.raycast import Raycaster

RADIUS, CENTRE = 0.4, np.array([0.1, -0.2, 0.15])


@pytest.fixture(scope="module")
def cameras() -> tuple[Camera, ...]:
    """Eight cameras around the origin at 3 m, portrait, small."""
    return RingRig().cameras(270, 480)


def sphere(radius: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Fine, outward, with vertices on the sphere; rounded so that seam and poles meet."""
    polar, around = np.linspace(0, np.pi, 121), np.arange(161) % 160 * (2 * np.pi / 160)
    v, u = np.meshgrid(polar, around, indexing="ij")
    points = np.stack([np.sin(v) * np.sin(u), np.cos(v), np.sin(v) * np.cos(u)], axis=-1).round(12)
    index = np.arange(points[..., 0].size).reshape(v.shape)
    a, b, c, d = (
        part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(points.reshape(-1, 3) * radius + centre, faces)


def crossings(camera):
    """Depth (H, W) of both crossings of the sphere's surface, NaN beside it."""
    rays = camera.ray_directions(camera.pixel_centres().reshape(-1, 2))
    offset = camera.position - CENTRE
    a, b = (rays * rays).sum(1), rays @ offset
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - a * (offset @ offset - RADIUS**2))
    shape = (camera.height, camera.width)
    return ((-b - root) / a).reshape(shape), ((-b + root) / a).reshape(shape), rays


@pytest.mark.parametrize("view", [0, 3])
def test_both_depths_of_a_sphere(view, cameras):
    caster, camera = Raycaster(sphere(RADIUS, tuple(CENTRE))), cameras[view]
    near, far, _ = crossings(camera)
    inner = far - near > 0.3 * RADIUS  # away from the rim, where a facet is millimetres off
    assert inner.sum() > 2000
    np.testing.assert_allclose(caster.cast(camera, "near").depth[inner], near[inner], atol=1e-3)
    np.testing.assert_allclose(caster.cast(camera, "far").depth[inner], far[inner], atol=1e-3)


def test_far_normals_point_away_along_the_same_rays(cameras):
    caster, camera = Raycaster(sphere(RADIUS, tuple(CENTRE))), cameras[1]
    near, far, rays = crossings(camera)
    inner = far - near > 0.3 * RADIUS
    for side, depth in (("near", near), ("far", far)):
        points = camera.position + rays * np.nan_to_num(depth).reshape(-1, 1)
        in_camera = ((points - CENTRE) / RADIUS) @ camera.rotation.T * (1.0, -1.0, -1.0)
        expected = in_camera.reshape(*depth.shape, 3)[inner]
        found = caster.normals(camera, side)[inner]
        assert np.degrees(np.arccos(np.clip((found * expected).sum(1), -1, 1))).max() < 0.5
    assert (caster.normals(camera, "far")[inner][:, 2] < 0).mean() > 0.99


def test_layers_between_are_not_seen(cameras):
    small, large = sphere(0.2), sphere(0.4)
    both = Mesh(
        np.concatenate([small.vertices, large.vertices]),
        np.concatenate([small.faces, large.faces + len(small.vertices)]),
    )
    for side in ("near", "far"):
        hits = Raycaster(both).cast(cameras[0], side)
        assert (hits.face[hits.mask] >= len(small.faces)).all()


def test_out_of_the_picture_nothing_is_met(cameras):
    hits = Raycaster(sphere(0.1, (0.0, 9.0, 0.0))).cast(cameras[0], "far")
    assert not hits.mask.any()
    assert np.isnan(hits.depth).all()
