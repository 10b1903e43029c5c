"""Bodies with a fit's errors: none of them is the truth, all of them are near it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from harness.core.truth import TrueParameters
from methods.body.models.anny_body import AnnyBody
from methods.body.models.model import neutral
from normal_training.sampling.perturbation import FitErrors, as_fitted

NONE = FitErrors(joint_deg=0.0, root_deg=0.0, place_m=0.0, phenotype=0.0)


@pytest.fixture(name="anny", scope="module")
def _anny():
    return AnnyBody()


@pytest.fixture(name="person", scope="module")
def _person(anny):
    """Parameters of one bent body, and its posed values."""
    parameters = neutral(anny)
    generator = torch.Generator().manual_seed(3)
    pose = 0.05 * torch.randn(parameters["pose"].shape, generator=generator)
    shift = torch.tensor([[0.02, 0.0, -0.03]])
    parameters |= {"pose": pose, "shape": parameters["shape"] + 0.05, "translation": shift}
    with torch.no_grad():
        return parameters, anny.posed(parameters)


@pytest.fixture(name="truth", scope="module")
def _truth(anny, person):
    exported = anny.export(person[0])
    names = [str(name) for name in exported["phenotype_names"]]
    values = [float(value) for value in exported["phenotype"]]
    pose = exported["pose_parameters"].astype(np.float64)
    return TrueParameters(pose, dict(zip(names, values, strict=True)))


def test_without_errors_it_is_the_body_itself(anny, person, truth):
    wanted = person[1].vertices[0].numpy()
    np.testing.assert_allclose(as_fitted(anny, truth, NONE, 0), wanted, atol=1e-5)


def test_fingers_are_at_rest(anny, truth):
    finger = anny.joint_names.index("finger2-1.L")
    bent = truth.pose_parameters.copy()
    bent[finger, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    straight = as_fitted(anny, truth, NONE, 0)
    crooked = as_fitted(anny, TrueParameters(bent, truth.phenotype), NONE, 0)
    np.testing.assert_array_equal(straight, crooked)


def test_place_alone_moves_the_whole_body(anny, truth):
    moved = as_fitted(anny, truth, FitErrors(0.0, 0.0, 0.05, 0.0, spread=0.0), 3)
    shift = moved - as_fitted(anny, truth, NONE, 3)
    np.testing.assert_allclose(shift, np.tile(shift[:1], (len(shift), 1)), atol=1e-5)
    assert 0.005 < np.linalg.norm(shift[0]) < 0.3


def test_errors_are_those_of_fits(anny, truth):
    true = as_fitted(anny, truth, NONE, 0)
    errors_mm = [
        1000 * np.linalg.norm(as_fitted(anny, truth, FitErrors(), seed) - true, axis=1).mean()
        for seed in range(24)
    ]
    # Eight views give about 15 mm, one view 100 and more: between them, and not all alike.
    assert 15 < np.median(errors_mm) < 70
    assert max(errors_mm) > 2 * min(errors_mm)


def test_equal_seeds_give_equal_bodies(anny, truth):
    first, second, other = (as_fitted(anny, truth, FitErrors(), seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, second)
    assert np.abs(first - other).max() > 1e-3
