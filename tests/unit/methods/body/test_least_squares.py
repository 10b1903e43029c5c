"""Levenberg and Marquardt on problems whose minima are known."""

from __future__ import annotations

import numpy as np
import torch

from methods.body.fit.landmark_fit import Residuals, minimum


class Valley:
    """Rosenbrock's valley: a sum of two squares that is 0 at (1, 1), and hard to descend."""

    def about(self, parameters, which):
        pass

    def residuals(self, parameters, which):
        x, y = parameters["x"][:, 0], parameters["y"][:, 0]
        return Residuals((), torch.stack([10 * (y - x**2), 1 - x], 1))


class Place:
    """The place (1, 2) that most readings agree on; some lie far away."""

    def __init__(self, readings):
        self.readings = torch.tensor(readings)
        self.weight = torch.ones(len(readings), dtype=torch.float64)

    def about(self, parameters, which):
        pass

    def residuals(self, parameters, which):
        off = (parameters["place"][:, None] - self.readings) / 0.01
        return Residuals(((off, self.weight.expand(off.shape[:2])),), off.new_zeros(len(off), 1))


def test_the_end_of_a_curved_valley_is_found():
    start = {"x": torch.tensor([[-1.2]]), "y": torch.tensor([[1.0]])}
    found, cost = minimum(Valley(), start)
    assert abs(float(found["x"]) - 1) < 1e-6
    assert abs(float(found["y"]) - 1) < 1e-6
    assert cost < 1e-12
    assert found["x"].dtype == torch.float64


def test_readings_far_away_do_not_pull():
    rng = np.random.default_rng(0)
    good = np.array([1.0, 2.0]) + 0.001 * rng.normal(size=(20, 2))
    far = rng.uniform(-3, 3, size=(6, 2))
    found, _ = minimum(Place(np.vstack([good, far])), {"place": torch.tensor([[1.05, 1.95]])})
    assert np.abs(found["place"].numpy()[0] - (1.0, 2.0)).max() < 0.002


def test_the_gradient_is_that_of_the_cost():
    """At the minimum the cost rises to every side, which a wrong weight would spoil."""
    rng = np.random.default_rng(1)
    problem = Place(np.array([1.0, 2.0]) + 0.02 * rng.normal(size=(9, 2)))
    found, cost = minimum(problem, {"place": torch.tensor([[1.0, 2.0]])})
    for step in ((1e-4, 0), (-1e-4, 0), (0, 1e-4), (0, -1e-4)):
        moved = {"place": found["place"] + torch.tensor([step], dtype=torch.float64)}
        assert float(problem.residuals(moved, torch.zeros(1)).cost()) > cost
