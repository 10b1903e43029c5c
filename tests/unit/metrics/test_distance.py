"""Distances between samples against slow, readable twins, and what they are worth."""

import numpy as np
import pytest

from harness.geometry.surface import SurfaceIndex
from metrics.distance import (
    chamfer_point_to_surface,
    chamfer_sample_to_sample,
    nearest_sample_mm,
    nearest_surface_mm,
    point_to_surface,
)
from metrics.sampling import sample_surface


def slow_nearest_mm(points, targets):
    return [1000 * min(np.linalg.norm(point - target) for target in targets) for point in points]


def test_nearest_samples_agree_with_brute_force():
    random = np.random.default_rng(0)
    points, targets = random.random((60, 3)), random.random((80, 3))
    np.testing.assert_allclose(nearest_sample_mm(points, targets), slow_nearest_mm(points, targets))


def test_chamfer_is_the_mean_of_both_directions():
    """Not their sum, not squared, not the maximum."""
    predicted = np.array([[0.0, 0, 0], [0, 0, 0.004]])
    truth = np.array([[0.0, 0, 0.001], [0, 0, 0.011]])
    found = chamfer_sample_to_sample(predicted, truth)
    assert found.value == pytest.approx(((1 + 3) / 2 + (1 + 7) / 2) / 2)
    assert (found.unit, found.n) == ("mm", 4)


def test_chamfer_between_surfaces_is_the_mean_of_accuracy_and_completeness():
    accuracy = point_to_surface(np.array([1.0, 2, 3, 4]), "independent")
    completeness = point_to_surface(np.array([5.0, 5, 5, 5]), "independent")
    found = chamfer_point_to_surface(accuracy, completeness)
    assert (found.value, found.unit, found.n, found.floor) == (3.75, "mm", 8, 0)
    assert found.standard_error == pytest.approx(accuracy.standard_error / 2)


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
        found.append(chamfer_sample_to_sample(*points))
    stated = np.mean([chamfer.standard_error for chamfer in found])
    assert 0.8 < stated / np.std([chamfer.value for chamfer in found]) < 1.3


def test_the_nearest_surface_point_is_nearer_than_any_sample(shapes):
    surface = SurfaceIndex(shapes.figure())
    points = np.random.default_rng(0).normal(size=(500, 3))
    targets = sample_surface(surface, 5000, "independent", 0).points
    closest, distances = nearest_surface_mm(points, surface)
    assert (distances <= nearest_sample_mm(points, targets) + 1e-3).all()
    np.testing.assert_allclose(1000 * np.linalg.norm(points - closest.points, axis=1), distances)
