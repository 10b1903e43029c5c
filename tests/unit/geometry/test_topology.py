"""Edges and pieces of meshes whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from harness.core.mesh import Mesh
from harness.geometry.coinciding import (
    components,
    concatenated,
    edges_of,
    half_edges,
    largest_piece,
    open_edges,
    pieces_of,
)

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def test_each_edge_of_a_tetrahedron_is_between_two_of_its_faces():
    edges = edges_of(TETRAHEDRON)
    np.testing.assert_array_equal(edges.ends, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
    assert (edges.counts == 2).all()
    for edge, faces in zip(edges.ends.tolist(), edges.faces().tolist(), strict=True):
        holders = [f for f, face in enumerate(TETRAHEDRON.tolist()) if set(edge) <= set(face)]
        assert sorted(faces) == holders
    start, end = half_edges(TETRAHEDRON)
    sides = np.sort(np.stack([start, end], axis=1), axis=1)
    np.testing.assert_array_equal(edges.ends[edges.of_side.ravel()], sides)


def test_borders_and_third_faces():
    fan = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    edges = edges_of(fan)
    assert edges.counts.tolist() == [3, 1, 1, 1, 1, 1, 1]
    assert edges.faces()[0].tolist() == [0, 1]
    assert (edges.faces()[1:, 1] == -1).all()


def test_quads_have_four_sides_and_hang_together_by_them():
    quads = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [6, 7, 8, 9]])
    edges = edges_of(quads)
    assert edges.of_side.shape == (3, 4)
    assert edges.counts.tolist().count(2) == 1
    assert edges.ends[edges.counts == 2].tolist() == [[1, 4]]
    pieces = pieces_of(quads, 11)
    assert pieces.of_face.tolist() == [0, 0, 1]
    assert pieces.face_counts.tolist() == [2, 1, 0]
    assert pieces.vertex_counts.tolist() == [6, 4, 1]


@given(arrays(np.int64, st.tuples(st.integers(0, 30), st.just(2)), elements=st.integers(0, 14)))
def test_groups_are_numbered_by_their_lowest_member(pairs):
    group = components(15, *pairs.T)
    expected = list(range(15))
    for _ in range(15):
        for a, b in pairs.tolist():
            expected[a] = expected[b] = min(expected[a], expected[b])
    lowest = {}
    assert [lowest.setdefault(root, len(lowest)) for root in expected] == group.tolist()


def test_the_largest_piece_is_that_with_the_most_vertices_not_faces():
    many_faces = Mesh(CORNERS, TETRAHEDRON)
    strip = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])
    flat = Mesh(np.array([[0.0, 0, 5], [0, 1, 5], [1, 0, 5], [1, 1, 5], [2, 0, 5]]), strip)
    both = concatenated([many_faces, flat])
    assert both.source == "mesh + mesh"
    kept = largest_piece(both)
    np.testing.assert_array_equal(kept.vertices, flat.vertices)
    np.testing.assert_array_equal(kept.faces, flat.faces)


@pytest.mark.parametrize(("faces", "count"), [(TETRAHEDRON, 0), (TETRAHEDRON[1:], 6)])
def test_open_edges_count_each_direction_without_its_opposite(faces, count):
    mesh = Mesh(CORNERS, faces)
    assert open_edges(mesh) == len(np.setxor1d(*directed(mesh))) == count


def directed(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    start, end = half_edges(mesh.faces)
    return start * 10 + end, end * 10 + start
