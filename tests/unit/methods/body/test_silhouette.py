"""The silhouette's gradient is that of the covered area."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import torch

from methods.body.fit.evidence import Projector
from methods.body.fit.losses import (
    BodySurface,
    SilhouetteTarget,
    Topology,
    silhouette_cost,
    uncovered_cost,
)


def smooth_coverage(camera, centre, width):
    """A soft blob: fractional coverage everywhere, so that a jump is known at every pixel."""
    x, y = np.moveaxis(camera.pixel_centres(), -1, 0)
    distance = np.hypot(x - centre[0], 1.3 * (y - centre[1]))
    return 1.0 / (1.0 + np.exp((distance - 70.0) / width))


@pytest.fixture(scope="module")
def finely_covered(ball, camera):
    """``finely_covered(motion, amount)``: coverage by the moved body, of finely divided pixels."""
    vertices, faces = ball
    topology = Topology(faces)

    @functools.cache
    def covered(motion, amount):
        surface = BodySurface(moved(vertices, motion, amount), topology)
        return surface.caster.coverage(camera, supersample=8)

    return covered


def exact_cost(body, coverage, uncovered):
    """Slow twin: coverage of finely divided pixels instead of the outline."""
    per_pixel = body * (1 - coverage) + (1 - body) * uncovered * coverage
    return per_pixel.sum() / 100.0**2


def moved(vertices, name, amount):
    shift = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
    if name == "scale":
        return vertices * (1 + amount)
    if name == "shear":
        return vertices + amount * np.outer(vertices[:, 1], (1, 0, 0))
    return vertices + amount * np.array(shift[name])


@pytest.mark.parametrize("uncovered", [1.0, 0.3])
@pytest.mark.parametrize("motion", ["x", "y", "z", "scale", "shear"])
def test_gradient_is_that_of_the_area(ball, camera, finely_covered, motion, uncovered):
    vertices, faces = ball
    coverage = smooth_coverage(camera, (128.0, 112.0), 6.0)
    missing = uncovered * coverage
    target = SilhouetteTarget(Projector(camera), coverage, 100.0**2, missing)
    leaf = torch.tensor(vertices, dtype=torch.float32, requires_grad=True)
    silhouette_cost(leaf, BodySurface(vertices, Topology(faces)), target).backward()
    direction = (moved(vertices, motion, 1e-3) - vertices) / 1e-3
    analytic = float((leaf.grad.double().numpy() * direction).sum())
    step = 0.01
    numeric = (
        exact_cost(finely_covered(motion, step), coverage, uncovered)
        - exact_cost(finely_covered(motion, -step), coverage, uncovered)
    ) / (2 * step)
    assert analytic == pytest.approx(numeric, rel=0.02, abs=0.02)


def test_value_is_the_weighted_area_of_the_difference(ball, camera):
    vertices, faces = ball
    surface = BodySurface(vertices, Topology(faces))
    mask = surface.caster.mask(camera)
    coverage = np.roll(mask, 7, axis=1).astype(float)
    target = SilhouetteTarget(Projector(camera), coverage, 10.0, 0.25 * coverage)
    cost = silhouette_cost(torch.tensor(vertices, dtype=torch.float32), surface, target)
    beyond, missing = (mask & (coverage == 0)).sum(), (~mask & (coverage == 1)).sum()
    assert missing > 0
    assert cost.item() == pytest.approx((beyond + 0.25 * missing) / 10.0)


def test_what_the_frame_cuts_off_does_not_pull(ball, pitched_camera):
    vertices, faces = ball
    camera = pitched_camera(0.0, 0.0).cropped(0, 0, 120, 240)
    inside = np.ones((240, 120))
    target = SilhouetteTarget(Projector(camera), inside, 1.0, inside)
    leaf = torch.tensor(vertices, dtype=torch.float32, requires_grad=True)
    silhouette_cost(leaf, BodySurface(vertices, Topology(faces)), target).backward()
    hidden = vertices[:, 0] > 0.05
    assert leaf.grad[torch.tensor(hidden)].abs().max() == 0
    assert leaf.grad.abs().max() > 0


def test_parts_in_front_of_the_body_have_no_outline(sphere, camera):
    large, faces = sphere(0.5)
    small, small_faces = sphere(0.1)
    toward = camera.position / np.linalg.norm(camera.position)
    vertices = np.concatenate([large, small + 0.8 * toward])
    nothing = np.zeros((240, 240))
    both = np.concatenate([faces, small_faces + len(large)])
    target = SilhouetteTarget(Projector(camera), nothing, 1.0, nothing)
    leaf = torch.tensor(vertices, dtype=torch.float32, requires_grad=True)
    silhouette_cost(leaf, BodySurface(vertices, Topology(both)), target).backward()
    assert leaf.grad[len(large) :].abs().max() == 0
    assert leaf.grad[: len(large)].abs().max() > 0


def test_a_missing_sign_would_be_noticed(ball, camera):
    """A body beside its target is pulled towards it, and grows where the target is larger."""
    vertices, faces = ball
    x, y = np.moveaxis(camera.pixel_centres(), -1, 0)
    right = ((x - 150) ** 2 + (y - 120) ** 2 < 80**2).astype(float)
    target = SilhouetteTarget(Projector(camera), right, 1.0, right)
    leaf = torch.tensor(vertices, dtype=torch.float32, requires_grad=True)
    silhouette_cost(leaf, BodySurface(vertices, Topology(faces)), target).backward()
    to_the_right = camera.rotation[0]
    assert float((leaf.grad.double().numpy() @ to_the_right).sum()) < 0


def test_the_rim_of_a_clothed_subject_costs_nothing():
    coverage = np.zeros((40, 40))
    coverage[:, 10:30] = 1.0
    missing = uncovered_cost(coverage, weight=0.5, standoff_px=3.0)
    row = missing[20]
    np.testing.assert_allclose(row[10:13], 0.0)
    np.testing.assert_allclose(row[13:27], 0.5)
    # The picture cuts the subject above and below: no rim there.
    np.testing.assert_allclose(missing[0], row)
    np.testing.assert_array_equal(uncovered_cost(coverage, 0.5, 0.0), 0.5 * coverage)
