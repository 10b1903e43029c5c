"""Openness and shadows against closed forms: a ball alone, a floor under a ball, a screen."""

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.geometry.occlusion import hidden_faces, hidden_share, lit_share, vertex_openness
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


def test_a_ball_inside_a_ball_is_hidden_and_no_more():
    inner, outer = ball(0.4, (0.1, 0.0, 0.0), 24), ball(0.6, (0.0, 0.0, 0.0), 24)
    clothed = joined(inner, outer)
    expected = np.arange(len(clothed.faces)) < len(inner[1])
    np.testing.assert_array_equal(hidden_faces(clothed), expected)
    assert hidden_share(clothed) == pytest.approx(0.4**2 / (0.4**2 + 0.6**2), abs=0.005)
    # It does not matter which way faces are turned, nor how large all is.
    turned = Mesh(1e4 * clothed.vertices, clothed.faces[:, ::-1])
    np.testing.assert_array_equal(hidden_faces(turned), expected)


def test_an_open_layer_hides_what_no_ray_through_its_hole_reaches():
    inner, (vertices, faces) = (ball(radius, (0.0, 0.0, 0.0), 30) for radius in (0.5, 0.6))
    # The upper third of the outer ball is cut off. Tangents of the inner one that pass its rim
    # touch at asin(0.2 / 0.6) - acos(0.5 / 0.6) = -14 degrees, 0.12 below the middle.
    shirt = joined(inner, (vertices, faces[vertices[faces][:, :, 1].mean(axis=1) < 0.2]))
    hidden = hidden_faces(shirt)
    height = shirt.vertices[shirt.faces].mean(axis=1)[:, 1]
    is_inner = np.arange(len(shirt.faces)) < len(inner[1])
    assert not hidden[~is_inner].any()
    assert not hidden[is_inner & (height > 0.1)].any()
    assert hidden[is_inner & (height < -0.2)].all()


@pytest.mark.parametrize("parts", [[ball(0.5, (0, 0, 0))], [floor(1.0)],
                                   [floor(1.0), ball(0.3, (0.0, 0.5, 0.0))]])  # fmt: skip
def test_what_is_seen_from_somewhere_is_not_hidden(parts):
    assert not hidden_faces(joined(*parts)).any()
    assert hidden_share(joined(*parts)) == 0.0


def test_large_faces_are_hidden_only_if_all_of_them_is():
    # A floor of four faces under a plate that covers the middle of each, but not their corners.
    plate = [floor(0.8)[0] + (0, 0.001, 0), floor(0.8)[1]]
    assert not hidden_faces(joined(floor(1.0), plate, (plate[0] - (0, 0.002, 0), plate[1]))).any()
