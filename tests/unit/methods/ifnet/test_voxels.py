"""What the network is shown of bodies and sheets whose voxels are known."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from methods.ifnet.completion import body_voxels, cube_around, sheet_voxels

SIDE = 64
BOX = np.array([[-0.31, -0.62, -0.22], [0.41, 0.73, 0.17]])


def box(bounds: np.ndarray) -> Mesh:
    """A closed box, outward."""
    corners = np.array([[bounds[x, 0], bounds[y, 1], bounds[z, 2]]
                        for x in (0, 1) for y in (0, 1) for z in (0, 1)])  # fmt: skip
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [corner for a, b, c, d in quads for corner in ((a, b, c), (a, c, d))]
    return Mesh(corners, np.array(faces))


def wall(z: float, left: float = -0.5, low: float = -0.8) -> Mesh:
    """A flat sheet at a depth, from (left, low) to (0.6, 0.7)."""
    points = np.array([[left, low, z], [0.6, low, z], [0.6, 0.7, z], [left, 0.7, z]])
    return Mesh(points, np.array([[0, 1, 2], [0, 2, 3]]))


def voxel_range(low: float, high: float) -> slice:
    """The voxels that an interval touches."""
    return slice(int(np.floor((low + 1) / 2 * SIDE)), int(np.floor((high + 1) / 2 * SIDE)) + 1)


def test_a_box_fills_the_voxels_that_it_touches_and_encloses():
    found = body_voxels(box(BOX), SIDE)
    x, y, z = (voxel_range(*BOX[:, axis]) for axis in range(3))
    wanted = np.zeros((SIDE,) * 3, bool)
    wanted[x, y, z] = True
    # By (z, y, x), y downwards.
    np.testing.assert_array_equal(found > 0, wanted.transpose(2, 1, 0)[:, ::-1])
    assert found.dtype == np.float32


def test_a_hole_as_wide_as_an_eye_does_not_let_the_inside_out():
    whole = box(BOX)
    # Without one of the triangles at its front, half of the columns along z are open there.
    front = np.abs(whole.vertices[whole.faces][:, :, 2] - BOX[1, 2]).max(axis=1) < 1e-9
    opened = Mesh(whole.vertices, whole.faces[~(front & (np.cumsum(front) == 1))])
    before, after = body_voxels(whole, SIDE), body_voxels(opened, SIDE)
    inner = voxel_range(*(BOX[:, 2] * 0.8))
    np.testing.assert_array_equal(after[inner], before[inner])


@pytest.mark.parametrize("z", [-0.3, 0.11])
def test_a_sheet_lies_between_two_slices_by_its_depth(z):
    found = sheet_voxels(wall(0.5), wall(z), SIDE)
    place = (z + 1) / 2 * SIDE - 1
    low = int(np.floor(place))
    row = SIDE // 2 - 1 - int(0.35 * SIDE / 2)  # y = 0.35, upwards, is above the middle
    column = SIDE // 2 + int(0.2 * SIDE / 2)
    there = found[:, row, column]
    assert there[low] == pytest.approx(1 - (place - low), abs=1e-5)
    assert there[low + 1] == pytest.approx(place - low, abs=1e-5)
    # Depth 0.5 is a slice's own: (0.5 + 1) / 2 * 64 - 1 = 47.
    assert there[47] == pytest.approx(1.0, abs=1e-5)
    assert there.sum() == pytest.approx(2.0, abs=1e-5)


def test_the_sheets_outline_is_the_right_way_up():
    found = sheet_voxels(wall(0.5), wall(-0.3), SIDE).sum(axis=0)
    middles = (2 * np.arange(SIDE) + 1) / SIDE - 1
    wide = (middles > -0.5) & (middles < 0.6)
    high = (middles > -0.8) & (middles < 0.7)
    np.testing.assert_allclose(found, 2.0 * high[::-1, None] * wide[None, :], atol=1e-5)


def test_the_front_counts_where_it_is_nearest_and_the_back_where_it_is_furthest():
    two = Mesh(
        np.concatenate([wall(0.1).vertices, wall(0.4).vertices]),
        np.concatenate([wall(0.1).faces, wall(0.4).faces + 4]),
    )
    np.testing.assert_array_equal(
        sheet_voxels(two, two, SIDE), sheet_voxels(wall(0.4), wall(0.1), SIDE)
    )


def test_what_meets_itself_weighs_one_at_most():
    assert sheet_voxels(wall(0.5), wall(0.5), SIDE).max() == 1.0


@pytest.mark.parametrize("view", [0, 3, 6])
def test_the_cube_is_turned_to_the_camera_and_nine_tenths_full(view):
    camera = RingRig().cameras(270, 480)[view]
    person = box(np.array([[-0.3, -0.8, -0.1], [0.5, 1.0, 0.2]]))
    moved = Mesh(person.vertices - camera.rotation[2] * 0.05, person.faces)
    cube = cube_around(camera, person, moved)
    points = person.transformed(cube.from_world).vertices
    low, high = points.min(axis=0), points.max(axis=0)
    np.testing.assert_allclose((low + high)[:2], 0, atol=1e-9)
    assert (high - low)[:2].max() == pytest.approx(1.8)
    # The body's middle, not the sheets', is the cube's along the view: 5 cm nearer.
    assert (low + high)[2] / 2 == pytest.approx(-0.05 * 1.8 / 1.8)
    np.testing.assert_allclose(cube.to_world @ cube.from_world, np.eye(4), atol=1e-12)
    # Towards the viewer is +z, upwards +y.
    towards = cube.from_world[:3, :3] @ (camera.position / np.linalg.norm(camera.position))
    assert towards[2] > 0.9
    assert (cube.from_world[:3, :3] @ (0, 1, 0))[1] > 0.9
