"""Pictures of meshes: who is in front, which way a surface faces, what a sheet of them holds."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from methods.normals import ViewMaps, WorkingView
from methods.stages import Stages, contact_sheet, normal_colours, shaded

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def wall(z: float, half: float, *, towards: bool = True) -> Mesh:
    corners = np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(corners, faces if towards else faces[:, ::-1])


@pytest.fixture
def camera() -> Camera:
    return RingRig().cameras(96, 96)[0]


def test_the_nearer_mesh_is_seen_whatever_their_order(camera):
    near, far = wall(0.5, 0.2), wall(0.0, 0.6)
    for meshes, colours in (([near, far], (RED, BLUE)), ([far, near], (BLUE, RED))):
        picture = shaded(meshes, colours, camera)
        np.testing.assert_allclose(picture[48, 48], RED, atol=0.02)
        np.testing.assert_allclose(picture[48, 25], BLUE, atol=0.02)
        np.testing.assert_array_equal(picture[0, 0], 1.0)


def test_a_back_is_dark(camera):
    picture = shaded([wall(0.0, 0.5, towards=False)], (RED,), camera)
    assert picture[48, 48].max() < 0.2


def test_normals_have_their_usual_colours():
    normals = np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]])
    np.testing.assert_allclose(
        normal_colours(normals)[0], [[0.5, 0.5, 1.0], [1.0, 0.5, 0.5], [1.0, 1.0, 1.0]]
    )


def test_a_sheet_has_a_row_for_each_view_and_stage(camera):
    mask = np.zeros((96, 96), bool)
    mask[10:86, 30:66] = True
    flat = np.where(mask[..., None], (0.0, 0.0, 1.0), 0.0)
    depth = np.where(mask, 3.0, np.nan)
    view = WorkingView(0, camera, mask[..., None] * np.array(RED), mask)
    maps = ViewMaps(view, flat, -flat, flat, -flat, depth, depth)
    body = wall(0.0, 0.4)
    one, two = (contact_sheet(Stages([maps] * n, [body], body, body)) for n in (1, 2))
    height = one.shape[0] // 4
    assert two.shape[0] == 5 * height
    assert one.shape[1] == two.shape[1]
    np.testing.assert_array_equal(one[height // 2, one.shape[1] // 8], (255, 0, 0))
    np.testing.assert_array_equal(two[:height], two[height : 2 * height])
    # A person fills a third of the square: the tiles are cut to what they show.
    assert one.shape[1] < 4 * height
