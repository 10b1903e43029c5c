"""The mesh: what it refuses, and its closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.mesh import Mesh

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE_FACES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])
TRIANGLE = np.array([[0, 1, 2]])


def cube() -> Mesh:
    return Mesh(CORNERS, CUBE_FACES, source="cube")


def test_closed_forms_of_a_unit_cube() -> None:
    mesh = cube()

    assert mesh.area == pytest.approx(6)
    assert mesh.signed_volume == pytest.approx(1)
    assert mesh.bounds.tolist() == [[0, 0, 0], [1, 1, 1]]
    assert mesh.extent.tolist() == [1, 1, 1]
    np.testing.assert_allclose(mesh.face_areas(), 0.5)
    outward = CORNERS[CUBE_FACES].mean(axis=1) - 0.5
    assert ((mesh.face_normals() * outward).sum(axis=1) > 0).all()


def test_inside_out_has_negative_volume_wherever_it_stands() -> None:
    mesh = Mesh(CORNERS + 1e4, CUBE_FACES[:, ::-1])

    assert mesh.signed_volume == pytest.approx(-1)


def test_a_similarity_scales_area_by_its_square() -> None:
    transform = np.diag([3.0, 3, 3, 1])
    transform[:3, 3] = [1, 2, 3]
    moved = cube().transformed(transform)

    assert moved.area == pytest.approx(54)
    assert moved.bounds.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cube().bounds.tolist() == [[0, 0, 0], [1, 1, 1]]


def test_bounds_do_not_count_vertices_without_faces() -> None:
    mesh = Mesh(np.vstack([CORNERS, [[9, 9, 9]]]), CUBE_FACES)

    assert mesh.bounds[1].tolist() == [1, 1, 1]


def test_submesh_keeps_the_chosen_faces_and_their_vertices() -> None:
    keep = np.arange(12) < 2
    part = cube().submesh(keep)

    assert part.vertices.shape == (4, 3)
    np.testing.assert_array_equal(part.vertices[part.faces], CORNERS[CUBE_FACES[:2]])
    with pytest.raises(DataError, match="cube has no faces"):
        cube().submesh(np.zeros(12, dtype=bool))


def test_geometry_drops_the_texture_and_nothing_else() -> None:
    textured = Mesh(CORNERS, CUBE_FACES, uv=CORNERS[:, :2], face_uv=CUBE_FACES)

    assert textured.geometry().uv is None
    np.testing.assert_array_equal(textured.geometry().faces, textured.faces)


def test_arrays_are_held_as_float64_and_int32() -> None:
    mesh = Mesh(CORNERS.astype(np.float32), CUBE_FACES.astype(np.uint64)[:, ::-1])

    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int32
    assert mesh.faces.flags.c_contiguous


def broken(row: int, value: float) -> np.ndarray:
    vertices = CORNERS.copy()
    vertices[row, 1] = value
    return vertices


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"vertices": np.zeros((0, 3))}, "thing has no usable vertices"),
        ({"vertices": CORNERS[:, :2]}, r"thing has no usable vertices .*\(8, 2\)"),
        ({"faces": np.zeros((0, 3), int)}, "thing has no faces .*8 vertices.*point cloud"),
        ({"faces": np.array([])}, "thing has no faces"),
        ({"faces": np.array([[0, 1, 2, 3]])}, "thing has no faces"),
        ({"vertices": broken(3, np.nan)}, r"1 non-finite vertices .*vertex 3 = \[0.0, nan, 1.0\]"),
        ({"vertices": broken(0, -np.inf)}, "1 non-finite vertices .*vertex 0"),
        ({"faces": np.array([[0, 1, 8]])}, "vertex index out of range .*0 to 7; got 8"),
        ({"faces": np.array([[0, 1, -1]])}, "vertex index out of range .*got -1"),
        ({"faces": np.array([[0, 1, 2**32 + 2]])}, "vertex index out of range .*4294967298"),
        ({"faces": np.array([[0, 1, 2.5]])}, "vertex index that is not a whole number"),
        ({"faces": np.array([[1, 1, 2]])}, "no measurable surface .*1 faces of total area 0"),
        ({"vertices": CORNERS * 1e200}, "no measurable surface .*area inf"),
        ({"vertices": CORNERS * 1e-200}, "no measurable surface .*area 0"),
        ({"uv": CORNERS[:, :2]}, "texture coordinates without their indices"),
        ({"face_uv": CUBE_FACES}, "texture coordinates without their indices"),
        ({"uv": CORNERS, "face_uv": CUBE_FACES}, "no usable texture coordinates"),
        ({"uv": CORNERS[:, :2], "face_uv": TRIANGLE}, "faces without texture coordinates"),
        ({"uv": CORNERS[:3, :2], "face_uv": CUBE_FACES}, "texture index out of range"),
        ({"uv": CORNERS[:, :2] * np.nan, "face_uv": CUBE_FACES}, "non-finite texture coordinates"),
    ],
)
def test_each_defect_has_its_own_error(arguments: dict, message: str) -> None:
    values = {"vertices": CORNERS, "faces": CUBE_FACES, "source": "thing", **arguments}

    with pytest.raises(DataError, match=message):
        Mesh(**values)
