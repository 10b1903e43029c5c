"""Angles and normal errors against slow, readable twins."""

import math

import numpy as np
import pytest

from harness.geometry.surface import SurfaceIndex
from metrics.normals import angles_deg, normal_summary
from metrics.score import score


def slow_angle_deg(first, second):
    first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
    return math.degrees(math.acos(max(-1.0, min(1.0, float(first @ second)))))


def random_units(seed, count):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_angles_agree_with_the_slow_twin():
    first, second = random_units(0, 500), random_units(1, 500)
    expected = [slow_angle_deg(a, b) for a, b in zip(first, second, strict=True)]
    np.testing.assert_allclose(angles_deg(first, second), expected, atol=1e-6)


def test_independent_normals_are_90_degrees_apart_and_one_radian_without_orientation():
    errors = angles_deg(random_units(0, 200_000), random_units(1, 200_000))
    assert errors.mean() == pytest.approx(90, abs=0.4)
    found = normal_summary(errors, errors)
    assert found.unoriented_mean_deg == pytest.approx(math.degrees(1), abs=0.2)
    assert found.median_deg == pytest.approx(90, abs=0.5)
    assert found.share_over_90 == pytest.approx(0.5, abs=0.005)


@pytest.mark.parametrize("tiny", [1e-12, 1e-9, 1e-6])
def test_tiny_angles_keep_their_digits(tiny):
    """An arc cosine would give 0 or 0.02 degrees here."""
    turned = np.array([[math.cos(tiny), math.sin(tiny), 0]])
    along = np.array([[1.0, 0, 0]])
    assert angles_deg(along, turned)[0] == pytest.approx(math.degrees(tiny), rel=1e-9)
    assert angles_deg(-along, turned)[0] == pytest.approx(180 - math.degrees(tiny), abs=1e-9)


def test_the_same_and_the_opposite_direction():
    units = random_units(2, 1000)
    np.testing.assert_array_equal(angles_deg(units, units), 0)
    np.testing.assert_array_equal(angles_deg(units, -units), 180)


def slow_normal(mesh, point):
    """Vertex normals interpolated on the face that ``point`` lies on, found by trying them all."""
    best = None
    for face in mesh.faces:
        corners = mesh.vertices[face]
        weights, *_ = np.linalg.lstsq(
            np.vstack([corners.T, np.ones(3)]), np.append(point, 1), rcond=None
        )
        off = np.linalg.norm(weights @ corners - point) + max(0, -weights.min())
        if best is None or off < best[0]:
            best = (off, face, weights)
    _, face, weights = best
    normal = np.zeros(3)
    for vertex, weight in zip(face, weights, strict=True):
        total = np.zeros(3)
        for other in mesh.faces:
            if vertex in other:
                a, b, c = mesh.vertices[other]
                total += np.cross(b - a, c - a)
        normal += weight * total / np.linalg.norm(total)
    return normal


def test_normal_errors_agree_with_a_loop_over_points(shapes, exact):
    """Few, large faces, so that weights given to the wrong vertices would show."""
    predicted = shapes.sphere(1.05, (0.1, 0.05, 0), level=1)
    truth = shapes.moved(shapes.sphere(level=1), matrix=shapes.rotation(0, 20))
    result = score(predicted, truth, exact, keep_points=True)
    found = result.predicted_points
    chosen = slice(None, None, 1000)
    points = found.points[chosen]
    nearest = SurfaceIndex(truth).closest(points)[0].points
    expected = [
        slow_angle_deg(slow_normal(predicted, point), slow_normal(truth, foot))
        for point, foot in zip(points, nearest, strict=True)
    ]
    np.testing.assert_allclose(found.normal_errors_deg[chosen], expected, atol=1e-3)
    assert result.metrics["normal_error"].value == pytest.approx(found.normal_errors_deg.mean())
