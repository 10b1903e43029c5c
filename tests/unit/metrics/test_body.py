"""Body metrics in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError
from metrics.body import (
    joint_error_mm,
    landmark_loss,
    normal_loss,
    silhouette_iou,
    silhouette_loss,
    total_loss,
    vertex_error_mm,
)


def square(left: int) -> np.ndarray:
    mask = np.zeros((40, 60), dtype=bool)
    mask[10:30, left : left + 20] = True
    return mask


def test_silhouettes_that_overlap_by_half():
    assert silhouette_loss(square(10), square(20), side_px=20.0) == pytest.approx(1.0)
    assert silhouette_iou(square(10), square(20)) == pytest.approx(1 / 3)


def test_equal_silhouettes():
    assert silhouette_loss(square(10), square(10), 20.0) == 0
    assert silhouette_iou(square(10), square(10)) == 1
    assert silhouette_iou(~square(0) & square(0), ~square(0) & square(0)) == 1


def test_losses_do_not_depend_on_the_pictures_size():
    large = [np.kron(square(left), np.ones((3, 3), bool)) for left in (10, 20)]
    small = silhouette_loss(square(10), square(20), 20.0)
    assert silhouette_loss(*large, 60.0) == pytest.approx(small)
    points = np.array([[1.0, 2.0], [5.0, 5.0]])
    assert landmark_loss(3 * points, 0 * points, np.ones(2), 60.0) == pytest.approx(
        landmark_loss(points, 0 * points, np.ones(2), 20.0)
    )


def test_opposite_normals_where_both_are_known():
    there = np.zeros((10, 10, 3))
    there[2:6, :, 2] = 1.0
    here = np.zeros((10, 10, 3))
    here[4:8, :, 2] = -1.0
    # 20 pixels overlap, each differs by 2 in one of three components.
    assert normal_loss(here, there, side_px=10.0) == pytest.approx(20 * (2 / 3) / 100)


def test_landmarks_count_by_confidence_in_half_sides():
    detected = np.array([[0.0, 0.0], [10.0, 0.0], [500.0, 500.0]])
    projected = np.array([[3.0, 4.0], [10.0, 1.0], [0.0, 0.0]])
    confidence = np.array([1.0, 0.5, 0.0])
    expected = (1.0 * 5 + 0.5 * 1) / 1.5 / 50.0
    assert landmark_loss(projected, detected, confidence, 100.0) == pytest.approx(expected)
    assert np.isnan(landmark_loss(projected, detected, np.zeros(3), 100.0))


def test_total_reproduces_the_printed_rows():
    """The paper's own rows: 0.103, 0.013, 1.259 print as 0.229 and 0.041, 0.008, 0.153 as 0.059."""
    assert total_loss(0.103, 0.013, 1.259) == pytest.approx(0.229, abs=0.003)
    assert total_loss(0.041, 0.008, 0.153) == pytest.approx(0.059, abs=0.002)


def test_errors_are_in_millimetres_and_not_aligned():
    truth = np.random.default_rng(0).normal(size=(12, 3))
    np.testing.assert_allclose(joint_error_mm(truth + np.array([0, 0.003, 0.004]), truth), 5.0)
    np.testing.assert_allclose(vertex_error_mm(truth, truth), 0.0)


@pytest.mark.parametrize("measure", [joint_error_mm, vertex_error_mm])
def test_other_bodies_are_refused(measure):
    with pytest.raises(DataError, match="different shapes"):
        measure(np.zeros((12, 3)), np.zeros((13, 3)))
