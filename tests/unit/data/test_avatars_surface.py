"""Subdivision, clipping and hems against shapes whose answer is known."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix, identity

from harness.data.avatars.garments import hem
from harness.data.avatars.surface import (
    Patch,
    boundary_edges,
    clip,
    compact,
    smooth,
    split_quads,
    subdivide,
    vertex_normals,
)
from harness.data.avatars.visibility import outer_faces


def grid(n: int) -> Patch:
    """The unit square at z = 0 in 2 n^2 triangles facing +Z, texture coordinates = position."""
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1)
    index = np.arange(x.size).reshape(n + 1, n + 1)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1)
    faces = split_quads(quads.reshape(-1, 4))
    return Patch(vertices, faces, csr_matrix(identity(len(vertices))), vertices[:, :2], faces)


def cube(side: float) -> tuple[np.ndarray, np.ndarray]:
    v = side * (np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)], float) - 0.5)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return v, split_quads(np.array(quads))


def area(patch: Patch) -> float:
    a, b, c = patch.vertices[patch.faces].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_a_flat_square_stays_itself_when_subdivided():
    fine = subdivide(grid(4), 2)
    assert len(fine.faces) == 32 * 16
    assert np.allclose(fine.vertices[:, 2], 0)
    # Borders become splines of themselves: straight sides stay, corners are rounded a little.
    assert area(fine) == pytest.approx(1.0, abs=0.02)
    assert np.allclose(np.asarray(fine.weights.sum(1)), 1)


def test_the_loop_rule_has_no_preferred_direction_on_a_cube():
    vertices, faces = cube(2.0)
    patch = Patch(vertices, faces, csr_matrix(identity(8)), vertices[:, :2], faces)
    fine = subdivide(patch, 3)
    assert len(boundary_edges(fine.faces)) == 0
    assert np.allclose(fine.vertices.mean(0), 0, atol=0.02)
    assert np.abs(fine.vertices).max() < 1.0


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1])
def test_a_clipped_square_has_the_area_below_the_line(angle):
    patch = grid(9)
    normal = np.array([np.cos(angle), np.sin(angle), 0])
    middle = np.array([0.5, 0.5, 0])
    half = clip(patch, (patch.vertices - middle) @ normal)
    assert area(half) == pytest.approx(0.5, abs=1e-6)
    assert ((half.vertices - middle) @ normal).min() > -1e-6
    assert np.allclose(half.uv[half.uv_faces], half.vertices[half.faces][..., :2])
    assert (vertex_normals(half.vertices, half.faces)[:, 2] > 0.999).all()


def test_clipping_carries_skinning_weights_along():
    patch = grid(5)
    carried = clip(patch, patch.vertices[:, 0] - 0.33)
    assert np.allclose(carried.weights @ patch.vertices, carried.vertices)


def test_a_hem_joins_the_sheet_and_turns_inwards():
    patch = grid(3)
    normals = vertex_normals(patch.vertices, patch.faces)
    hemmed = hem(patch, normals, np.full(len(patch.vertices), 0.02))
    assert len(hemmed.faces) == len(patch.faces) + 2 * len(boundary_edges(patch.faces))
    assert hemmed.vertices[:, 2].min() == pytest.approx(-0.02)
    # One open rim is left, the inner one.
    rim = boundary_edges(hemmed.faces)
    assert np.allclose(hemmed.vertices[rim][..., 2], -0.02)
    sides = vertex_normals(hemmed.vertices, hemmed.faces[len(patch.faces) :])
    outward = hemmed.vertices - [0.5, 0.5, 0]
    rim_vertices = np.unique(rim)
    assert (np.einsum("vi,vi->v", sides, outward)[rim_vertices] > 0).all()


def test_smoothing_holds_the_border_and_flattens_a_spike():
    patch = grid(8)
    spike = patch.vertices.copy()
    spike[40, 2] = 1.0
    flat = smooth(spike, patch.faces, 50)
    border = np.unique(boundary_edges(patch.faces))
    assert np.array_equal(flat[border], spike[border])
    assert flat[:, 2].max() < 0.1


def test_compact_drops_what_is_not_used():
    patch = grid(2)
    keep = np.zeros(len(patch.faces), bool)
    keep[3] = True
    one = compact(patch, keep)
    assert one.vertices.shape == (3, 3)
    assert np.allclose(one.vertices[one.faces[0]], patch.vertices[patch.faces[3]])


def test_an_inner_cube_is_not_seen():
    outer, faces = cube(1.0)
    inner, _ = cube(0.4)
    seen = outer_faces(np.concatenate([outer, inner]), np.concatenate([faces, faces + 8]))
    assert seen[:12].all()
    assert not seen[12:].any()
