"""Rotations averaged on SO(3)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from methods.body.fit.landmark_fit import (
    mean_of_columns,
    mean_rotation,
    mean_rotation_vector,
    upright,
)


def test_mean_of_turns_about_one_axis_is_the_mean_angle():
    vectors = np.array([[0, 0.2, 0], [0, 0.5, 0], [0, 0.8, 0]])
    np.testing.assert_allclose(mean_rotation_vector(vectors), [0, 0.5, 0], atol=1e-12)


def test_mean_goes_the_short_way_round():
    """350 and 10 degrees average to 0, not to 180 as their numbers do."""
    vectors = np.radians([[0, 0, 175.0], [0, 0, -175.0]])
    assert np.linalg.norm(mean_rotation_vector(vectors)) == pytest.approx(np.pi)


def test_mean_moves_with_the_frame():
    rotations = Rotation.random(5, random_state=2).as_matrix()
    turn = Rotation.from_rotvec([0.3, -0.4, 1.0]).as_matrix()
    np.testing.assert_allclose(mean_rotation(turn @ rotations), turn @ mean_rotation(rotations))


def test_mean_has_the_least_sum_of_squared_distances():
    rotations = Rotation.from_rotvec(np.random.default_rng(0).normal(0, 0.6, (6, 3))).as_matrix()
    mean = mean_rotation(rotations)
    cost = ((rotations - mean) ** 2).sum()
    for step in np.random.default_rng(1).normal(0, 0.05, (20, 3)):
        other = Rotation.from_rotvec(step).as_matrix() @ mean
        assert ((rotations - other) ** 2).sum() > cost


def test_upright_body_has_its_left_where_it_is_told():
    rotation = upright(np.array([0.0, 0.3, -2.0]))
    np.testing.assert_allclose(rotation[:, 0], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(upright(np.array([0.0, 1.0, 0.0])), np.eye(3))


def test_the_mean_of_columns_is_that_of_six_numbers():
    """Turns about one axis by 0 and 90 degrees have the mean of 45; others a known skew."""
    turns = np.array([np.eye(3), [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]])
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        mean_of_columns(turns), [[half, -half, 0], [half, half, 0], [0, 0, 1]], atol=1e-12
    )
    # The second column gives way to the first.
    turns[1] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    turns = np.concatenate([turns, [[[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]]])
    first = np.array([2.0, 0.0, -1.0]) / np.sqrt(5)
    second = np.array([0.0, 2.0, 1.0]) / 3
    second -= first * (first @ second)
    found = mean_of_columns(turns)
    np.testing.assert_allclose(found[:, 0], first, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], second / np.linalg.norm(second), atol=1e-12)
    np.testing.assert_allclose(found.T @ found, np.eye(3), atol=1e-12)
