"""Known deviations of landmarks come back from pictures of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from harness.core.rigs import RingRig
from harness.run.calibration import deviations_mm, remaining_mm, symmetric_means
from methods.body.models.anatomy import blend_landmarks
from methods.body.models.model import LandmarkTable, Posed
from methods.body.photos.detection import COUNT, Detections

CAMERAS = RingRig(views=8).cameras(540, 960)


def knee(offset_m):
    """A table of one landmark, in the middle of two vertices, and so far off along each axis."""
    return LandmarkTable(
        landmarks=np.array([25]),
        vertices=np.array([[0, 1]]),
        weights=np.array([[0.5, 0.5]], dtype=np.float32),
        carriers=np.array([0]),
        offsets=np.full((1, 3), offset_m, dtype=np.float32),
        trust=np.ones(1, dtype=np.float32),
    )


def seen(point):
    return np.array([camera.project(point[None])[0][0] for camera in CAMERAS])


def test_a_deviation_is_told_in_the_carriers_rest_axes():
    """A carrier that is turned by a quarter about +Y carries (0, 0, 20) mm to (20, 0, 0)."""
    quarter = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    posed = Posed(
        torch.tensor([[[0.1, 0, 0], [0.3, 0, 0]]]), torch.zeros(1, 1, 3), quarter[None, None]
    )
    table = knee(9.0)
    pixels = np.zeros((8, COUNT, 2))
    pixels[:, 25] = seen(np.array([0.22, 0.0, 0.0]))
    found = Detections(pixels, np.zeros((8, COUNT, 3)), np.ones((8, COUNT)), np.ones((8, 2)))
    deviation = deviations_mm(CAMERAS, found, posed, table)
    np.testing.assert_allclose(deviation, [[0.0, 0.0, 20.0]], atol=1e-3)


def test_what_remains_of_a_fit_is_told_in_the_true_carriers_rest_axes():
    """The fitted skin is 20 mm off along +X, where a quarter turn about +Y has brought +Z."""
    quarter = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])[None, None]
    skin = torch.tensor([[[0.1, 0, 0], [0.3, 0, 0]]])
    table = knee(0.009)
    body = SimpleNamespace(
        landmarks=table, landmark_points=lambda posed: blend_landmarks(table, posed)
    )
    truth = Posed(skin, torch.zeros(1, 1, 3), quarter)
    fitted = Posed(skin + torch.tensor([0.02, 0.0, 0.0]), torch.zeros(1, 1, 3), quarter)
    np.testing.assert_allclose(remaining_mm(fitted, truth, body), [[0.0, 0.0, 20.0]], atol=1e-3)
    np.testing.assert_allclose(remaining_mm(truth, truth, body), 0.0)


def test_means_are_symmetric_and_an_odd_subject_does_little():
    left = np.array([10.0, -5.0, 3.0])
    right, nose = left * [-1, 1, 1], np.array([0.0, 4.0, 1.0])
    noise = np.random.default_rng(0).normal(0, 1.0, (12, 3, 3))
    deviations = np.array([nose, left, right]) + noise
    deviations[0] += 200.0
    means, spreads = symmetric_means(deviations, [0, 25, 26])
    np.testing.assert_allclose(means, [nose, left, right], atol=1.0)
    np.testing.assert_allclose(means[1] * [-1, 1, 1], means[2], atol=1e-9)
    assert means[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert (spreads < 3.0).all()
    exact, none = symmetric_means(deviations[1:] - noise[1:], [0, 25, 26])
    np.testing.assert_allclose(exact, [nose, left, right], atol=1e-9)
    np.testing.assert_allclose(none, 0.0, atol=1e-9)
