"""Surfaces of fields with a closed form, and which points are asked for."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import MethodError
from harness.geometry.coinciding import open_edges
from methods.ifnet.completion import contoured_field, refined

CENTRE, RADIUS = np.array([0.11, -0.2, 0.07]), 0.55
NOTHING = np.zeros((64, 64, 64), bool)


class Counted:
    """A field that remembers where it was asked."""

    def __init__(self, field) -> None:
        self.field, self.asked = field, []

    def __call__(self, points):
        self.asked.append(points)
        return self.field(points).astype(np.float32)


def ball(points):
    return 0.5 + RADIUS - np.linalg.norm(points - CENTRE, axis=1)


def test_a_ball_comes_back_closed_outward_and_in_its_place():
    field = Counted(ball)
    mesh = contoured_field(field, 128, NOTHING)
    radius = np.linalg.norm(mesh.vertices - CENTRE, axis=1)
    # Between lattice points a ball's distance is not linear: by cell^2 / 8 / radius.
    np.testing.assert_allclose(radius, RADIUS, atol=2e-4)
    assert open_edges(mesh) == 0
    assert mesh.signed_volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=2e-3)
    asked = np.concatenate(field.asked)
    assert len(np.unique(asked, axis=0)) == len(asked), "no point is asked for twice"
    assert len(asked) < 0.15 * 129**3
    beyond = np.abs(ball(np.concatenate(field.asked[1:])) - 0.5)
    assert beyond.max() < 3 * np.sqrt(3) * 2 / 32


def test_refined_values_are_the_fields_own_near_the_surface_and_its_sign_elsewhere():
    values = refined(Counted(ball), 64, NOTHING)
    axis = np.linspace(-1, 1, 65)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    true = ball(grid).reshape(values.shape)
    near = np.abs(true - 0.5) < 2 / 64
    np.testing.assert_allclose(values[near], true[near], atol=1e-6)
    assert ((values > 0.5) == (true > 0.5)).all()


def test_what_is_too_thin_for_the_coarsest_lattice_is_found_where_something_was_shown():
    def rod(points):  # between the coarsest lattice's lines, which are 0.0625 apart
        return 0.515 - np.linalg.norm(points[:, :2] - 0.03125, axis=1)

    with pytest.raises(MethodError, match="empty.*above one half"):
        contoured_field(Counted(rod), 64, NOTHING)
    shown = NOTHING.copy()
    shown[32:34, 32:34] = True
    mesh = contoured_field(Counted(rod), 64, shown)
    np.testing.assert_allclose(np.abs(mesh.vertices[:, 2]).max(), 1.0, atol=0.04)
    assert open_edges(mesh) == 0, "it is closed where it leaves the cube"


def test_only_the_largest_piece_stays():
    def two(points):
        return np.maximum(ball(points), 0.6 - np.linalg.norm(points + 0.75, axis=1))

    mesh = contoured_field(Counted(two), 64, NOTHING)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - CENTRE, axis=1), RADIUS, atol=1e-3)
