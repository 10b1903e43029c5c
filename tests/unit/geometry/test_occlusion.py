"""Openness and shadows against closed forms: a ball alone, a floor under a ball, a screen."""

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.geometry.occlusion import lit_share, vertex_openness
from harness.geometry.raycast import Raycaster


def ball(radius, centre, rings=60):
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij"
    )
    points = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=-1
    )
    index = np.arange(polar.size).reshape(polar.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return radius * points.reshape(-1, 3) + centre, faces


def floor(half):
    corners = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1], [0, 0, 0]]) * half
    return corners, np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


def joined(*parts):
    starts = np.cumsum([0, *[len(vertices) for vertices, _ in parts]])
    return Mesh(
        vertices=np.concatenate([vertices for vertices, _ in parts]),
        faces=np.concatenate(
            [faces + start for (_, faces), start in zip(parts, starts, strict=False)]
        ),
        source="test",
    )


def test_a_convex_surface_sees_everything():
    openness = vertex_openness(Raycaster(joined(ball(0.5, 0.0))), 64, 0)
    assert openness.min() > 0.98  # facets hide a ray or two at their own edges
    assert openness.mean() == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("height", [1.5, 2.0, 4.0])
def test_a_ball_hides_its_form_factor_from_the_floor_below(height):
    # A small patch that faces a ball of radius r at distance h loses (r / h)^2 of its light.
    # 20 rings of chords cover 0.4 % less than the ball, and every vertex casts all the rays.
    mesh = joined(floor(0.1), ball(1.0, np.array([0.0, height, 0.0]), rings=20))
    openness = vertex_openness(Raycaster(mesh), 4096, 0)[4]
    assert openness == pytest.approx(1 - 1 / height**2, abs=0.015)


def test_equal_seeds_give_equal_openness():
    caster = Raycaster(joined(floor(1.0), ball(0.3, np.array([0.0, 0.5, 0.0]), rings=12)))
    first, second, other = (vertex_openness(caster, 32, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, second)
    assert (first != other).any()


def test_a_half_hidden_lamp_gives_half_its_light():
    # The lamp is a row of points at height 2; the ball hides those that stand behind it.
    caster = Raycaster(joined(ball(0.2, np.array([0.0, 1.0, 0.0]))))
    lamp = np.array([[x, 2.0, 0.0] for x in (-0.1, 0.1, -3.0, 3.0)])
    share = lit_share(caster, np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]]), lamp)
    np.testing.assert_allclose(share, [0.5])
