"""Errors of vertices on cases that can be worked out by hand."""

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.geometry.surface import SurfaceIndex
from metrics.body import vertex_errors

SQUARE = Mesh(
    np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
)


def lifted(angle_deg, height_m):
    """A small square over the middle of the large one, turned about the x axis."""
    turn = np.radians(angle_deg)
    rotation = np.array(
        [[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]]
    )
    return Mesh(0.2 * SQUARE.vertices @ rotation.T + [0, 0, height_m], SQUARE.faces)


def test_parallel_squares_are_as_far_as_they_are_apart():
    found = vertex_errors(lifted(0, 0.03), SurfaceIndex(SQUARE))

    assert found.distance_mm == pytest.approx(np.full(4, 30.0), abs=1e-3)
    assert found.normal_deg == pytest.approx(np.zeros(4), abs=1e-4)


@pytest.mark.parametrize("angle_deg", [10.0, 90.0, 180.0])
def test_a_turned_square_is_as_wrong_as_it_is_turned(angle_deg):
    found = vertex_errors(lifted(angle_deg, 0.5), SurfaceIndex(SQUARE))

    assert found.normal_deg == pytest.approx(np.full(4, angle_deg), abs=1e-4)


def test_a_vertex_without_faces_has_a_distance_and_no_normal_error():
    mesh = lifted(0, 0.03)
    found = vertex_errors(
        Mesh(np.vstack([mesh.vertices, [[0, 0, 1.0]]]), mesh.faces), SurfaceIndex(SQUARE)
    )

    assert found.distance_mm[4] == pytest.approx(1000.0, abs=1e-3)
    assert np.isnan(found.normal_deg).tolist() == [False] * 4 + [True]
