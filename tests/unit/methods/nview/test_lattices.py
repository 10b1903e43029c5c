"""Winding numbers, distances and contours of surfaces that run through themselves."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.geometry.coinciding import concatenated, open_edges
from methods.closed.lattices import (
    Lattice,
    contoured,
    lattice_around,
    remeshed,
    signed_distance,
    way_to_others,
    winding,
)

RADIUS = 0.2


def moved(mesh: Mesh, x: float) -> Mesh:
    return Mesh(mesh.vertices + np.array([x, 0, 0]), mesh.faces)


def inside_out(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


def at(mesh: Mesh, *xs: float) -> list[int]:
    """Winding numbers at points on the x axis."""
    places = [Lattice(np.array([x, 0.003, 0.002]), 0.01, (1, 1, 1)) for x in xs]
    return [winding(mesh, place).item() for place in places]


def test_a_point_is_enclosed_as_often_as_there_are_surfaces_around_it(ball):
    assert at(ball, 0.0, 0.3) == [1, 0]
    assert at(concatenated([ball, moved(ball, 0.1)]), -0.15, 0.05, 0.25, 0.4) == [1, 2, 1, 0]
    assert at(inside_out(ball), 0.0) == [-1]
    assert at(concatenated([ball, inside_out(moved(ball, 0.1))]), -0.15, 0.05, 0.25) == [1, 0, -1]


def test_distances_are_exact_near_the_surface(ball):
    lattice = lattice_around(ball.bounds, 0.01)
    field = signed_distance(ball, lattice, 0.03)
    points = lattice.points(np.argwhere(np.ones(lattice.shape, dtype=bool)))
    exact = RADIUS - np.linalg.norm(points, axis=1).reshape(lattice.shape)
    np.testing.assert_allclose(field, np.clip(exact, -0.03, 0.03), atol=5e-4)


def test_the_way_to_two_points_is_that_to_the_nearer():
    chosen = np.ones((12, 9, 7), dtype=bool)
    others = np.array([[2, 3, 4], [10, 0, 6]])
    chosen[tuple(others.T)] = False
    indices = np.argwhere(np.ones_like(chosen))
    exact = np.linalg.norm(indices[:, None] - others, axis=2).min(axis=1).reshape(chosen.shape)
    np.testing.assert_allclose(way_to_others(chosen, 0.5), 0.5 * exact, rtol=1e-6)


def test_parts_that_overlap_become_one(ball):
    apart = 0.2
    both = remeshed(concatenated([ball, moved(ball, apart)]), 0.01)
    assert open_edges(both) == 0
    cap = RADIUS - apart / 2
    lens = 2 * np.pi * cap**2 * (3 * RADIUS - cap) / 3
    assert both.signed_volume == pytest.approx(2 * 4 / 3 * np.pi * RADIUS**3 - lens, rel=0.01)


def test_what_has_turned_inside_out_is_gone(ball):
    """A bubble within the ball that faces inwards is a hollow; outside the ball it is nothing."""
    small = Mesh(0.5 * ball.vertices, ball.faces)
    outside = concatenated([ball, inside_out(moved(small, 0.5))])
    assert remeshed(outside, 0.01).signed_volume == pytest.approx(ball.signed_volume, rel=0.01)


def test_the_largest_piece_stays(ball):
    small = moved(Mesh(0.3 * ball.vertices, ball.faces), 0.4)
    left = remeshed(concatenated([ball, small]), 0.01)
    assert left.bounds[1, 0] == pytest.approx(RADIUS, abs=0.002)


def test_remeshing_keeps_the_shape_and_evens_the_edges(ball):
    mesh = remeshed(ball, 0.01)
    off = np.abs(np.linalg.norm(mesh.vertices, axis=1) - RADIUS)
    assert off.max() < 5e-4
    edges = np.linalg.norm(
        mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, axis=1)], axis=2
    )
    assert edges.min() > 0.001
    assert edges.mean() == pytest.approx(0.01, rel=0.3)


def test_an_empty_field_is_an_error():
    lattice = Lattice(np.zeros(3), 0.01, (5, 5, 5))
    with pytest.raises(MethodError, match="the visual hull is empty"):
        contoured(lattice, np.full((5, 5, 5), -1.0, dtype=np.float32), "visual hull")
