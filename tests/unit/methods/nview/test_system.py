"""The sparse problem of one round, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.mesh import Mesh
from methods.closed.surfaces import Surface, smoothed_along
from methods.nview.system import MoveProblem, PairRows, SingleRows, slope_rows


def single(vertex: int, value: float, weight: float, coefficient: float = 1.0) -> SingleRows:
    return SingleRows(
        np.array([vertex]), np.array([coefficient]), np.array([value]), np.array([weight])
    )


def equal(first: int, second: int, apart: float, weight: float) -> PairRows:
    one = np.array([1.0])
    return PairRows(
        np.array([first]), np.array([second]), one, -one, apart * one, np.array([weight])
    )


def test_weighted_means():
    problem = MoveProblem(2)
    problem.add_single(single(0, 1.0, 3.0))
    problem.add_single(single(0, 5.0, 1.0))
    problem.add_single(single(1, 6.0, 2.0, coefficient=3.0))
    np.testing.assert_allclose(problem.solved(), [2.0, 2.0], rtol=1e-9)


def test_a_chain_is_a_straight_line():
    """Ends held, neighbours asked to be equal: the moves between are linear."""
    problem = MoveProblem(5)
    problem.add_single(single(0, 0.0, 1e9))
    problem.add_single(single(4, 4.0, 1e9))
    problem.add_pairs([equal(k, k + 1, 0.0, 1.0) for k in range(4)])
    np.testing.assert_allclose(problem.solved(), np.arange(5.0), rtol=1e-6, atol=1e-6)


def test_the_normal_equations_are_those_of_the_rows():
    rng = np.random.default_rng(3)
    first, second = rng.integers(0, 6, 40), rng.integers(0, 6, 40)
    apart = first != second
    first, second = first[apart], second[apart]
    a, b, values, weights = rng.uniform(0.2, 1, (4, len(first)))
    problem = MoveProblem(6)
    problem.add_pairs([PairRows(first, second, a, b, values, weights)])
    problem.add_single(single(2, 0.5, 2.0))
    rows = np.zeros((len(first) + 1, 6))
    rows[np.arange(len(first)), first] = a
    rows[np.arange(len(first)), second] = b
    rows[-1, 2] = 1.0
    scale = np.sqrt(np.append(weights, 2.0))
    exact = np.linalg.lstsq(scale[:, None] * rows, scale * np.append(values, 0.5), rcond=None)[0]
    np.testing.assert_allclose(problem.solved(), exact, rtol=1e-6)


@pytest.fixture
def plate() -> Surface:
    """A flat square of 20 x 20 cells of 1 cm in the plane z = 0; open, which does not matter."""
    axis = np.arange(21) * 0.01
    x, y = np.meshgrid(axis, axis, indexing="ij")
    index = np.arange(441).reshape(21, 21)
    a, b, c, d = (
        part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Surface(Mesh(np.stack([x.ravel(), y.ravel(), np.zeros(441)], 1), faces))


def test_slopes_tilt_a_plate(plate):
    """Asked for a tilted normal everywhere and held at one vertex, the plate becomes that plane."""
    normal = np.array([0.3, -0.2, 1.0])
    normal /= np.linalg.norm(normal)
    problem = MoveProblem(441)
    problem.add_pairs(slope_rows(plate, np.tile(normal, (800, 1)), np.ones(800)))
    problem.add_single(single(0, 0.05, 1.0))
    expected = 0.05 - (plate.mesh.vertices @ normal) / normal[2]
    np.testing.assert_allclose(problem.solved(), expected, atol=1e-6)


def test_directions_are_the_plates_normal(plate):
    np.testing.assert_allclose(plate.directions, np.tile([0, 0, 1.0], (441, 1)), atol=1e-12)
    assert plate.vertex_areas_m2.sum() == pytest.approx(0.04)
    np.testing.assert_allclose(plate.at_vertices(np.full(800, 0.7)), 0.7)


def test_spreading_along_the_surface_keeps_it(ball):
    rng = np.random.default_rng(0)
    radial = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    shift = rng.normal(0, 5e-4, ball.vertices.shape)
    shift -= np.einsum("ij,ij->i", shift, radial)[:, None] * radial
    shaken = ball.vertices + shift
    shaken *= 0.2 / np.linalg.norm(shaken, axis=1, keepdims=True)
    calm = smoothed_along(Surface(Mesh(shaken, ball.faces)), 5, 0.5).mesh

    def spread(mesh):
        way = mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, axis=1)]
        return np.linalg.norm(way, axis=2).std()

    assert spread(calm) < 0.8 * spread(Mesh(shaken, ball.faces))
    assert np.abs(np.linalg.norm(calm.vertices, axis=1) - 0.2).max() < 3e-4
