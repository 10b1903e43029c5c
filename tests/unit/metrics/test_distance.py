"""Distances between samples against slow, readable twins, and what they are worth."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from harness.geometry.surface import SurfaceIndex
from metrics.distance import (
    harmonic_mean,
    mean_of_directions,
    nearest_samples,
    nearest_surface_mm,
    sample_mean,
    sample_surface,
)


def slow_nearest(points, targets):
    return [min(np.linalg.norm(point - target) for target in targets) for point in points]


def chamfer_of_samples(predicted, truth):
    there, back = (
        sample_mean(1000 * nearest_samples(*pair)[0], "mm", "independent")
        for pair in ((predicted, truth), (truth, predicted))
    )
    return mean_of_directions(there, back, together=True)


def test_nearest_samples_agree_with_brute_force():
    random = np.random.default_rng(0)
    points, targets = random.random((60, 3)), random.random((80, 3))
    distances, which = nearest_samples(points, targets)
    np.testing.assert_allclose(distances, slow_nearest(points, targets))
    np.testing.assert_allclose(np.linalg.norm(points - targets[which], axis=1), distances)


def test_nearest_samples_are_scipys_to_the_last_bit():
    random = np.random.default_rng(0)
    points, targets = random.normal(size=(2, 20_000, 3))
    expected = KDTree(targets).query(points)
    for found, value in zip(nearest_samples(points, targets), expected, strict=True):
        np.testing.assert_array_equal(found, value)


def test_chamfer_is_the_mean_of_both_directions():
    """Not their sum, not squared, not the maximum."""
    predicted = np.array([[0.0, 0, 0], [0, 0, 0.004]])
    truth = np.array([[0.0, 0, 0.001], [0, 0, 0.011]])
    found = chamfer_of_samples(predicted, truth)
    assert found.value == pytest.approx(((1 + 3) / 2 + (1 + 7) / 2) / 2)
    assert (found.unit, found.n) == ("mm", 4)


def test_directions_that_err_apart_have_a_smaller_error():
    accuracy = sample_mean(np.array([1.0, 2, 3, 4]), "mm", "independent")
    completeness = sample_mean(np.array([5.0, 5, 5, 5]), "mm", "independent")
    found = mean_of_directions(accuracy, completeness, together=False)
    assert (found.value, found.unit, found.n, found.floor) == (3.75, "mm", 8, 0)
    assert found.standard_error == pytest.approx(accuracy.standard_error / 2)


def test_an_f_score_of_nothing_is_nothing():
    """Tanks and Temples divides 0 by 0 there."""
    none = sample_mean(np.zeros(4), "%", "independent")
    half = sample_mean(np.array([0, 0, 100, 100.0]), "%", "independent")
    assert harmonic_mean(none, none).value == 0
    assert harmonic_mean(none, half).value == 0
    assert harmonic_mean(half, half).value == pytest.approx(50)
    assert harmonic_mean(half, half).standard_error == pytest.approx(half.standard_error / 2**0.5)


@pytest.mark.parametrize("shift", [0.0, 0.05])
def test_the_standard_error_of_chamfer_is_that_of_repeated_samples(shapes, shift):
    first = SurfaceIndex(shapes.sphere(level=3))
    second = SurfaceIndex(shapes.sphere(1, (shift, 0, 0), level=3))
    found = []
    for seed in range(100):
        points = [
            sample_surface(surface, 500, "independent", 2 * seed + side).points
            for side, surface in enumerate((first, second))
        ]
        found.append(chamfer_of_samples(*points))
    stated = np.mean([chamfer.standard_error for chamfer in found])
    assert 0.8 < stated / np.std([chamfer.value for chamfer in found]) < 1.3


def test_the_nearest_surface_point_is_nearer_than_any_sample(shapes):
    surface = SurfaceIndex(shapes.figure())
    points = np.random.default_rng(0).normal(size=(500, 3))
    targets = sample_surface(surface, 5000, "independent", 0).points
    closest, distances = nearest_surface_mm(points, surface)
    assert (distances <= 1000 * nearest_samples(points, targets)[0] + 1e-3).all()
    np.testing.assert_allclose(1000 * np.linalg.norm(points - closest.points, axis=1), distances)
