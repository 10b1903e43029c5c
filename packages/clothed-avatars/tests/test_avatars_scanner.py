"""Scanner noise: as strong as asked for, along the normals, alike among neighbours."""

import numpy as np
import pytest
from skimage.measure import marching_cubes

from clothed_avatars.mesh.scanner import scanned


@pytest.fixture(scope="module")
def ball():
    """A closed surface of radius 1 whose normals are known."""
    axis = np.linspace(-1.2, 1.2, 41)
    field = np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij")), axis=0)
    vertices, faces, _, _ = marching_cubes(field, 1.0, spacing=(0.06,) * 3)
    vertices -= 1.2
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces[:, ::-1]


def heights_mm(ball, noise_mm, seed=3):
    moved = scanned(*ball, noise_mm, seed)
    return moved, 1000 * (np.linalg.norm(moved, axis=1) - 1)


def test_the_bumps_are_as_high_as_asked_for_and_stand_on_the_surface(ball):
    moved, heights = heights_mm(ball, 2.0)
    assert abs(heights.std() - 2.0) < 0.02
    assert abs(heights.mean()) < 0.3
    sideways = moved - ball[0] * (moved * ball[0]).sum(axis=1, keepdims=True)
    assert 1000 * np.linalg.norm(sideways, axis=1).mean() < 0.3


def test_neighbours_move_alike(ball):
    _, heights = heights_mm(ball, 2.0)
    ends = ball[1][:, :2]
    assert np.corrcoef(heights[ends].T)[0, 1] > 0.5


def test_no_noise_changes_nothing_and_equal_seeds_are_equal(ball):
    assert scanned(*ball, 0.0, 3) is ball[0]
    first, again, other = (heights_mm(ball, 1.0, seed)[1] for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert np.abs(np.corrcoef(first, other)[0, 1]) < 0.2
