"""Normals at pixels and their gradient."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from harness.geometry.surface import vertex_normals as reference_normals
from methods.body.fit.evidence import Projector
from methods.body.fit.losses import (
    BodySurface,
    NormalTarget,
    Skin,
    Topology,
    normal_cost,
    seen_normals,
    vertex_normals,
)


def skin_of(vertices, faces):
    index = torch.tensor(faces)
    return Skin(vertices, vertex_normals(vertices, index), index)


def hits_of(vertices, faces, camera):
    return BodySurface(vertices, Topology(faces)).caster.cast(camera)


def pixels_of(hits):
    rows, columns = np.nonzero(hits.mask)
    rows, columns = rows[::37], columns[::37]
    return hits.face[rows, columns], np.stack([columns, rows], 1) + 0.5, (rows, columns)


def test_vertex_normals_equal_the_reference(ball):
    vertices, faces = ball
    surface = BodySurface(vertices, Topology(faces))
    ours = vertex_normals(torch.tensor(vertices), torch.tensor(faces))
    np.testing.assert_allclose(ours.numpy(), reference_normals(surface.caster.mesh), atol=1e-9)


def test_normals_at_pixels_equal_the_ray_caster(ball, camera):
    vertices, faces = ball
    surface = BodySurface(vertices, Topology(faces))
    hits = surface.caster.cast(camera)
    face, pixels, where = pixels_of(hits)
    seen = seen_normals(skin_of(torch.tensor(vertices), faces), face, pixels, Projector(camera))
    wanted = surface.caster.normals(camera)[where]
    np.testing.assert_allclose(seen.numpy(), wanted, atol=1e-4)
    assert wanted[:, 2].max() > 0.9


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (0, 0, 1)])
def test_gradient_is_that_of_the_picture(ball, camera, direction):
    vertices, faces = ball
    vertices = vertices * (1.0, 1.4, 0.8)
    surface = BodySurface(vertices, Topology(faces))
    face, pixels, _ = pixels_of(surface.caster.cast(camera))
    weights = torch.linspace(-1, 1, 3 * len(face), dtype=torch.float64).reshape(-1, 3)

    def value(amount):
        moved = leaf + amount * torch.tensor(direction, dtype=torch.float64)
        return (
            weights * seen_normals(skin_of(moved, faces), face, pixels, Projector(camera))
        ).sum()

    leaf = torch.tensor(vertices)
    amount = torch.zeros((), dtype=torch.float64, requires_grad=True)
    value(amount).backward()
    step = 1e-5
    numeric = (value(step) - value(-step)).item() / (2 * step)
    assert amount.grad.item() == pytest.approx(numeric, rel=1e-3, abs=1e-2)


def test_cost_falls_towards_the_true_place(ball, camera):
    vertices, faces = ball
    truth = BodySurface(vertices, Topology(faces)).caster.normals(camera)
    target = NormalTarget(Projector(camera), truth, 100.0**2, most_pixels=5000)
    moved = vertices + np.array([0.05, 0.0, 0.0])
    leaf = torch.tensor(moved, dtype=torch.float32, requires_grad=True)
    cost = normal_cost(skin_of(leaf, faces), hits_of(moved, faces, camera), target)
    cost.backward()
    assert cost.item() > 0
    assert leaf.grad[:, 0].sum() > 0
    same = normal_cost(
        skin_of(torch.tensor(vertices), faces), hits_of(vertices, faces, camera), target
    )
    assert same.item() < 1e-3 * cost.item() + 1e-6


def test_no_overlap_costs_nothing_and_does_not_fail(ball, camera):
    vertices, faces = ball
    target = NormalTarget(Projector(camera), np.zeros((240, 240, 3)), 1.0)
    leaf = torch.tensor(vertices, requires_grad=True)
    cost = normal_cost(skin_of(leaf, faces), hits_of(vertices, faces, camera), target)
    cost.backward()
    assert cost.item() == 0
    assert leaf.grad.abs().max() == 0


def test_one_pixel_more_of_overlap_leaves_the_others_as_they_are(ball, camera):
    vertices, faces = ball
    seen = BodySurface(vertices, Topology(faces)).caster.normals(camera)
    target = NormalTarget(Projector(camera), np.where(seen, [0.0, 1.0, 0.0], 0.0), 1.0, 300)
    skin, hits = skin_of(torch.tensor(vertices), faces), hits_of(vertices, faces, camera)
    whole = normal_cost(skin, hits, target).item()
    rows, columns = np.nonzero(hits.mask)
    pixels = len(rows)
    for number in (0, pixels // 2, pixels - 1):
        hits.face[rows[number], columns[number]] = -1  # as where an outline moves by a hair
        less = normal_cost(skin, hits, target).item()
        assert 0 <= whole - less <= 3 * (2 / 3) * np.ceil(pixels / 300) + 1e-9
