"""Closest points and vertex normals against slow, readable twins."""

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.geometry.coinciding import merged_positions
from harness.geometry.surface import SurfaceIndex, SurfacePoints, vertex_normals

TETRAHEDRON = Mesh(
    vertices=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float),
    faces=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)


def cross(a, b):
    """The product of two vectors (3,), many times as fast as numpy's for one pair."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def closest_on_triangle(point, a, b, c):
    """The nearest point of a triangle: of its plane if that falls inside, else of an edge."""
    normal = cross(b - a, c - a)
    if normal @ normal > 0:
        foot = point - normal * ((point - a) @ normal) / (normal @ normal)
        edges = [(a, b), (b, c), (c, a)]
        if all(cross(q - p, foot - p) @ normal >= 0 for p, q in edges):
            return foot
    candidates = []
    for p, q in [(a, b), (b, c), (c, a)]:
        edge = q - p
        t = np.clip((point - p) @ edge / (edge @ edge), 0, 1) if edge @ edge > 0 else 0.0
        candidates.append(p + t * edge)
    return min(candidates, key=lambda candidate: np.linalg.norm(point - candidate))


def slow_distances(points, mesh):
    """Brute force: every query against every triangle, in float64."""
    return np.array(
        [
            min(
                np.linalg.norm(point - closest_on_triangle(point, *mesh.vertices[face]))
                for face in mesh.faces
            )
            for point in points
        ]
    )


def slow_vertex_normals(mesh):
    """For each vertex, the sum of the area vectors of all faces that touch its position."""
    normals = np.zeros_like(mesh.vertices)
    for i, vertex in enumerate(mesh.vertices):
        for face in mesh.faces:
            a, b, c = mesh.vertices[face]
            touches = [bool((corner == vertex).all()) for corner in (a, b, c)]
            normals[i] += sum(touches) * np.cross(b - a, c - a) / 2
        length = np.linalg.norm(normals[i])
        normals[i] = normals[i] / length if length > 1e-9 else 0
    return normals


def random_soup(seed, vertices=30, faces=40):
    rng = np.random.default_rng(seed)
    corners = np.array([rng.choice(vertices, 3, replace=False) for _ in range(faces)])
    return Mesh(vertices=rng.normal(size=(vertices, 3)), faces=corners)


def test_the_slow_twin_itself():
    a, b, c = np.eye(3)
    np.testing.assert_allclose(closest_on_triangle(np.array([1.0, 1, 1]), a, b, c), [1 / 3] * 3)
    np.testing.assert_allclose(closest_on_triangle(np.array([2.0, -1, 0]), a, b, c), a)
    np.testing.assert_allclose(closest_on_triangle(np.array([1.0, 1, -1]), a, b, c), [0.5, 0.5, 0])


@pytest.mark.parametrize("seed", range(3))
def test_distances_agree_with_brute_force(seed):
    mesh = random_soup(seed)
    queries = np.random.default_rng(100 + seed).normal(size=(100, 3)) * 2
    _, distances = SurfaceIndex(mesh).closest(queries)
    np.testing.assert_allclose(distances, slow_distances(queries, mesh), atol=1e-6)


@pytest.mark.nightly
def test_two_thousand_closest_points_agree_with_float64_brute_force():
    mesh = random_soup(7, vertices=24, faces=20)
    queries = np.random.default_rng(8).normal(size=(2000, 3))
    _, distances = SurfaceIndex(mesh).closest(queries)
    np.testing.assert_allclose(distances, slow_distances(queries, mesh), atol=1e-6)


def test_the_closest_point_lies_on_its_face_with_its_weights():
    mesh = random_soup(4)
    queries = np.random.default_rng(5).normal(size=(500, 3))
    found, distances = SurfaceIndex(mesh).closest(queries)
    corners = mesh.vertices[mesh.faces[found.faces]]
    np.testing.assert_allclose(
        np.einsum("nk,nkj->nj", found.barycentric, corners), found.points, atol=1e-12
    )
    np.testing.assert_allclose(found.barycentric.sum(axis=1), 1, atol=1e-12)
    assert found.barycentric.min() > -1e-6
    np.testing.assert_allclose(np.linalg.norm(found.points - queries, axis=1), distances)


def test_barycentric_weights_belong_to_the_vertices_in_their_order():
    """The trap: Open3D's (u, v) are the weights of the second and the third vertex."""
    index = SurfaceIndex(Mesh(vertices=np.eye(3), faces=np.array([[0, 1, 2]])))
    weights = np.array([[0.7, 0.2, 0.1], [0.1, 0.7, 0.2], [0.2, 0.1, 0.7]])
    found, _ = index.closest(weights @ np.eye(3))
    np.testing.assert_allclose(found.barycentric, weights, atol=1e-6)


def test_a_far_origin_costs_no_precision():
    mesh = random_soup(6)
    queries = np.random.default_rng(7).normal(size=(500, 3))
    offset = np.array([1000.0, -1000.0, 1000.0])
    moved = Mesh(vertices=mesh.vertices + offset, faces=mesh.faces)
    _, near = SurfaceIndex(mesh).closest(queries)
    _, far = SurfaceIndex(moved).closest(queries + offset)
    np.testing.assert_allclose(far, near, atol=1e-6)


def test_faces_without_area_are_never_the_answer():
    vertices = np.vstack([TETRAHEDRON.vertices, [[0.5, 0, 0], [9, 9, 9], [8, 8, 8], [7, 7, 7]]])
    faces = np.vstack([[[5, 6, 7], [0, 4, 1], [2, 2, 3]], TETRAHEDRON.faces])
    index = SurfaceIndex(Mesh(vertices=vertices, faces=faces))
    queries = np.random.default_rng(1).normal(size=(300, 3)) * 5
    found, distances = index.closest(queries)
    assert found.faces.min() >= 3
    expected = SurfaceIndex(TETRAHEDRON).closest(queries)[1]
    np.testing.assert_allclose(distances, expected, atol=1e-5)
    assert np.isfinite(index.normals(found)).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_points_that_cannot_be_measured_are_refused(bad):
    points = np.array([[0.0, 0, 0], [0, bad, 0]])
    with pytest.raises(DataError, match="not finite"), np.errstate(all="ignore"):
        SurfaceIndex(TETRAHEDRON).closest(points)


def test_a_vertex_that_cannot_be_searched_is_refused():
    vertices = TETRAHEDRON.vertices.copy()
    vertices[1] = 1e20
    with pytest.raises(DataError, match="a vertex of giant is not finite"):
        SurfaceIndex(Mesh(vertices=vertices, faces=TETRAHEDRON.faces, source="giant"))


@pytest.mark.parametrize("seed", range(3))
def test_vertex_normals_agree_with_the_slow_twin(seed):
    mesh = random_soup(seed)
    split = Mesh(vertices=mesh.vertices[mesh.faces.ravel()], faces=np.arange(120).reshape(40, 3))
    np.testing.assert_allclose(vertex_normals(mesh), slow_vertex_normals(mesh), atol=1e-9)
    np.testing.assert_allclose(vertex_normals(split), slow_vertex_normals(split), atol=1e-9)


def test_a_seam_does_not_change_vertex_normals():
    mesh = random_soup(9)
    split = Mesh(vertices=mesh.vertices[mesh.faces.ravel()], faces=np.arange(120).reshape(40, 3))
    np.testing.assert_allclose(
        vertex_normals(split), vertex_normals(mesh)[mesh.faces.ravel()], atol=1e-12
    )


def test_vertex_normals_weigh_faces_by_area():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 3.0]])
    mesh = Mesh(vertices=vertices, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    np.testing.assert_allclose(vertex_normals(mesh)[0], np.array([3, 0, 1]) / np.sqrt(10))


def test_a_sheet_without_thickness_keeps_its_face_normals():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    index = SurfaceIndex(Mesh(vertices=vertices, faces=np.array([[0, 1, 2], [0, 2, 1]])))
    np.testing.assert_array_equal(vertex_normals(index.mesh), 0)
    where = SurfacePoints(
        points=np.full((2, 3), 1 / 3), faces=np.array([0, 1]), barycentric=np.full((2, 3), 1 / 3)
    )
    np.testing.assert_allclose(index.normals(where), [[0, 0, 1], [0, 0, -1]])


def test_positions_merge_exactly_and_nothing_else():
    vertices = np.array([[0.0, 1, 2], [3, 4, 5], [-0.0, 1, 2], [3, 4, np.nextafter(5, 6)]])
    group = merged_positions(vertices)
    assert group[0] == group[2]
    assert len(set(group)) == 3


def test_positions_merge_as_a_dictionary_would():
    vertices = np.random.default_rng(0).integers(-3, 4, size=(500, 3)) / 8
    group = merged_positions(vertices)
    numbers = {}
    for position, number in zip(map(tuple, vertices.tolist()), group.tolist(), strict=True):
        assert numbers.setdefault(position, number) == number
    assert sorted(numbers.values()) == list(range(len(numbers)))


def test_an_unused_vertex_has_no_normal_and_does_no_harm():
    vertices = np.vstack([TETRAHEDRON.vertices, [[100.0, 100, 100]]])
    mesh = Mesh(vertices=vertices, faces=TETRAHEDRON.faces)
    np.testing.assert_array_equal(vertex_normals(mesh)[4], 0)
    np.testing.assert_allclose(SurfaceIndex(mesh).centre, [0.5, 0.5, 0.5])


def test_smooth_normals_end_where_texture_coordinates_differ():
    """By value: two coordinates that are equal are one, whatever their numbers."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 3, 1]])
    uv = np.array([[0, 0], [1, 0], [0, 1], [0, 0], [0.5, 0.5]])
    where = SurfacePoints(
        points=vertices[[0, 1]], faces=np.array([0, 0]), barycentric=np.eye(3)[[0, 1]]
    )
    both, alone = np.array([0, 1, 1]) / np.sqrt(2), [0, 0, 1]
    for face_uv, expected in (
        ([[0, 1, 2], [3, 2, 1]], [both, both]),
        ([[0, 1, 2], [3, 2, 4]], [both, alone]),
        ([[0, 1, 2], [4, 2, 1]], [alone, both]),
    ):
        mesh = Mesh(vertices=vertices, faces=faces, uv=uv, face_uv=np.array(face_uv))
        split, smooth = SurfaceIndex(mesh, split_seams=True), SurfaceIndex(mesh)
        np.testing.assert_allclose(split.smooth_normals(where), expected, atol=1e-12)
        np.testing.assert_allclose(smooth.smooth_normals(where), [both, both], atol=1e-12)


def test_smooth_normals_that_cancel_are_not_numbers():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    index = SurfaceIndex(Mesh(vertices=vertices, faces=np.array([[0, 1, 2], [0, 2, 1]])))
    where = index.at(np.array([0, 1]), np.full((2, 3), 1 / 3))
    assert np.isnan(index.smooth_normals(where)).all()
