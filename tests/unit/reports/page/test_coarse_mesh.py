"""The coarse form of meshes: how large it is, how far from the mesh, and what values it has."""

import numpy as np
import pytest

from harness.core.mesh import Mesh
from reports.page.meshes import COARSE_FACES, ScalarColumn, coarse_mesh
from tests.unit.reports.page.pages import square

CELLS = 60
FACES = 2 * CELLS**2


def rolled(cells=CELLS):
    """A square rolled to an open tube of radius 0.5 m."""
    flat = square(cells)
    angle = flat.vertices[:, 0] * 3.5
    points = np.stack([np.sin(angle) / 2, flat.vertices[:, 1], np.cos(angle) / 2], axis=1)
    return Mesh(points, flat.faces)


@pytest.mark.parametrize("about", [300, 1000, 3000])
def test_it_has_about_as_many_faces_as_are_wanted(about):
    coarse = coarse_mesh(rolled(), about=about)

    assert 0.6 * about < coarse.faces < 1.6 * about


def test_a_person_of_many_faces_becomes_one_of_the_usual_number():
    cells = 400
    coarse = coarse_mesh(rolled(cells))

    assert 2 * cells**2 > 10 * COARSE_FACES
    assert 0.7 * COARSE_FACES < coarse.faces < 1.4 * COARSE_FACES


def test_a_small_mesh_has_none():
    assert coarse_mesh(rolled()) is None
    assert coarse_mesh(rolled(), about=FACES // 2 + 1) is None


def test_it_lies_on_the_mesh_and_covers_it():
    mesh = rolled()
    coarse, _ = coarse_mesh(mesh, about=1000).decoded()
    radius = np.linalg.norm(coarse.vertices[:, [0, 2]], axis=1)

    assert radius == pytest.approx(0.5, abs=0.01)
    assert coarse.area == pytest.approx(mesh.area, rel=0.1)
    assert coarse.extent == pytest.approx(mesh.extent, abs=0.08)


def test_its_faces_look_where_those_of_the_mesh_look():
    coarse, _ = coarse_mesh(rolled(), about=1000).decoded()
    corners = coarse.vertices[coarse.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = corners.mean(axis=1) * [1, 0, 1]
    facing = np.einsum("fc,fc->f", normals, outward)

    assert (facing > 0).mean() > 0.99


def test_values_are_means_of_the_vertices_nearby():
    mesh = square(CELLS)
    # A mean of a linear value is the value of the mean of the points.
    column = ScalarColumn("height", 20 + 10 * mesh.vertices[:, 1], 0.001)
    coarse, values = coarse_mesh(mesh, (column,), about=500).decoded()

    assert values["height"] == pytest.approx(20 + 10 * coarse.vertices[:, 1], abs=0.002)


def test_vertices_without_a_value_have_no_part_in_a_mean():
    mesh = square(CELLS)
    values = np.full(len(mesh.vertices), 7.0)
    values[::3] = np.nan
    values[mesh.vertices[:, 0] < 0] = np.nan
    coarse, found = coarse_mesh(mesh, (ScalarColumn("d", values, 0.5),), about=500).decoded()

    assert found["d"][coarse.vertices[:, 0] > 0.1] == pytest.approx(7.0)
    assert np.isnan(found["d"][coarse.vertices[:, 0] < -0.1]).all()


def test_a_vertex_of_no_face_changes_nothing():
    mesh = rolled()
    stray = Mesh(np.concatenate([[[90.0, 0, 0]], mesh.vertices]), mesh.faces + 1)
    values = np.arange(float(len(mesh.vertices)))
    column = ScalarColumn("d", values, 1.0)
    shifted = ScalarColumn("d", np.concatenate([[1e6], values]), 1.0)

    assert coarse_mesh(stray, (shifted,), about=900) == coarse_mesh(mesh, (column,), about=900)


def test_pieces_far_apart_do_not_make_it_empty():
    mesh = rolled()
    away = Mesh(
        np.concatenate([mesh.vertices, [[900.0, 0, 0], [900, 0.1, 0], [900, 0, 0.1]]]),
        np.concatenate([mesh.faces, [np.arange(3) + len(mesh.vertices)]]),
    )
    coarse = coarse_mesh(away, about=1000)

    assert coarse is None or coarse.faces > 200
