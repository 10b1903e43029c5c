"""The size of a scan: loose specks do not count, spikes are told, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.data.scans import stature
from tests.box_person import box_person

PERSON = box_person(1.7)
SPECK = np.array([[0.0, 0.0, 0.0], [0.003, 0.0, 0.0], [0.0, 0.002, 0.003]])


def with_specks(person: Mesh, *places: tuple[float, float, float]) -> Mesh:
    starts = len(person.vertices) + 3 * np.arange(len(places))
    return Mesh(
        np.concatenate([person.vertices, *[SPECK + place for place in places]]),
        np.concatenate([person.faces, starts[:, None] + np.arange(3)]),
    )


@pytest.mark.parametrize(
    "places", [[(0, 2.5, 0)], [(0.1, -0.8, 0)], [(0, 2.5, 0), (0, -0.8, 0), (2, 1, 0)]]
)
@pytest.mark.parametrize("units", [1.0, 1000.0])
def test_specks_beyond_the_person_do_not_count_and_are_told(places, units):
    mesh = with_specks(PERSON, *places)
    found = stature(Mesh(mesh.vertices * units, mesh.faces))
    np.testing.assert_allclose(found.extent, PERSON.extent * units, rtol=1e-9)
    assert len(found.told) == 1
    assert "loose specks" in found.told[0]


def test_specks_between_its_ends_change_nothing():
    found = stature(with_specks(PERSON, (0.0, 1.0, 0.0), (0.01, 0.9, 0.0)))
    np.testing.assert_array_equal(found.extent, PERSON.extent)
    assert found.told == ()


def test_a_vertex_of_no_face_does_not_count():
    mesh = Mesh(np.concatenate([PERSON.vertices, [[0.0, 9.0, 0.0]]]), PERSON.faces)
    np.testing.assert_array_equal(stature(mesh).extent, PERSON.extent)


def test_a_surface_of_loose_triangles_has_no_specks():
    soup = Mesh(PERSON.vertices[PERSON.faces].reshape(-1, 3) + 1e-8 * np.arange(216)[:, None],
                np.arange(216).reshape(-1, 3))  # fmt: skip
    assert stature(soup).told == ()


def ball() -> Mesh:
    import trimesh

    found = trimesh.creation.icosphere(4)
    return Mesh(found.vertices, found.faces)


@pytest.mark.parametrize(("axis", "sign", "words"), [(1, 1, "+y"), (0, -1, "-x"), (2, 1, "+z")])
def test_a_spike_is_told_and_counts(axis, sign, words):
    plain = ball()
    vertices = plain.vertices.copy()
    vertices[np.argmax(sign * vertices[:, axis]), axis] += sign * 0.5
    found = stature(Mesh(vertices, plain.faces))
    assert found.extent[axis] == pytest.approx(2.5, abs=0.01)
    assert len(found.told) == 1
    assert f"a spike sticks out by 0.5 towards {words}" in found.told[0]


@pytest.mark.parametrize("mesh", [PERSON, ball()])
def test_nothing_is_told_of_a_plain_surface(mesh):
    assert stature(mesh).told == ()
