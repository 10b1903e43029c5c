"""Closed surfaces and crossing faces of solids for which both can be counted."""

from __future__ import annotations

import time

import numpy as np
import pytest
import trimesh

from harness.core.mesh import Mesh
from harness.geometry.coinciding import concatenated
from metrics.photos import self_intersecting, soundness


def ball(radius=1.0, centre=(0.0, 0.0, 0.0), level=3) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=level, radius=radius)
    return Mesh(made.vertices + np.asarray(centre), made.faces, source="ball")


def crossing_pairs(mesh: Mesh) -> np.ndarray:
    """(F,) by trying every edge with every face: plain, slow, and independent of rays."""
    points, faces = mesh.vertices, mesh.faces
    sides = faces[:, [[0, 1], [1, 2], [2, 0]]]
    found = np.zeros(len(faces), dtype=bool)
    for owner, edges in enumerate(sides):
        for first, last in edges:
            start, along = points[first], points[last] - points[first]
            a, b, c = points[faces].transpose(1, 0, 2)
            matrix = np.stack([b - a, c - a, np.broadcast_to(-along, a.shape)], axis=-1)
            regular = np.abs(np.linalg.det(matrix)) > 1e-14
            solved = np.full((len(faces), 3), np.nan)
            solved[regular] = np.linalg.solve(matrix[regular], (start - a)[regular][..., None])[
                ..., 0
            ]
            u, v, t = solved.T
            with np.errstate(invalid="ignore"):
                met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1)
            met &= ~np.isin(faces, (first, last)).any(axis=1)
            found |= met
            found[owner] |= met.any()
    return found


@pytest.mark.parametrize("offset", [(1.0, 0.1, 0.05), (1.6, 0.0, 0.03), (0.05, 0.03, 0.02)])
def test_two_balls_that_overlap_cross_where_every_pair_says(offset):
    scene = concatenated([ball(level=2), ball(0.8, offset, level=2)])
    expected = crossing_pairs(scene)
    # The last lies wholly within the first.
    assert expected.any() == (offset[0] > 0.1)
    np.testing.assert_array_equal(self_intersecting(scene), expected)


def test_a_ball_is_sound_wherever_it_lies_and_however_its_vertices_are_split():
    whole = ball(0.9, (100.0, -50.0, 30.0))
    split = Mesh(whole.vertices[whole.faces.ravel()], np.arange(whole.faces.size).reshape(-1, 3))
    for mesh in (whole, split):
        found = soundness(mesh)
        assert found.watertight
        assert found.self_intersecting_faces == 0
        assert found.faces == 1280


def test_a_hole_is_not_watertight_and_has_as_many_open_edges_as_its_rim():
    whole = ball()
    found = soundness(whole.submesh(np.arange(len(whole.faces)) != 7))
    assert not found.watertight
    assert found.open_edges == 3


def test_two_triangles_cross_or_do_not():
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=float)
    for height, crossing in ((0.5, 2), (2.0, 0)):
        blade = np.array(
            [[0.2, 0.2, -0.5 + height], [0.3, 0.2, -0.5 + height], [0.25, 0.2, height]]
        )
        blade[:, 2] -= 0.2
        mesh = Mesh(np.concatenate([flat, blade]), np.arange(6).reshape(2, 3))
        assert self_intersecting(mesh).sum() == crossing


def test_a_dent_that_comes_out_on_the_other_side_crosses_it():
    mesh = ball(level=3)
    vertices = mesh.vertices.copy()
    top = vertices[:, 1].argmax()
    vertices[top] = (0.02, -1.2, 0.01)
    found = soundness(Mesh(vertices, mesh.faces))
    assert found.watertight
    assert found.self_intersecting_faces >= 6


@pytest.mark.nightly
def test_many_faces_take_a_few_seconds():
    mesh = ball(level=7)
    assert len(mesh.faces) > 150_000
    start = time.process_time()
    assert soundness(mesh).self_intersecting_faces == 0
    assert time.process_time() - start < 6.0
