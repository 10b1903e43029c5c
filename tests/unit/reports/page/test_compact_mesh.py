"""The compact form of meshes: what comes back, how exactly, and that equal gives equal."""

import base64
import gzip

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from reports.page.meshes import CompactMesh, ScalarColumn
from tests.unit.reports.page.pages import square

TRIANGLE = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 0.5, 0]]), np.array([[2, 0, 1]]))


def scrambled(seed, cells):
    """A bumpy square whose vertices and faces are in no order, with a vertex of no face."""
    generator = np.random.default_rng(seed)
    mesh = square(cells)
    place = generator.permutation(len(mesh.vertices))
    vertices = np.empty((len(place) + 1, 3))
    vertices[place] = mesh.vertices + generator.normal(0, 0.05, mesh.vertices.shape)
    vertices[-1] = 50.0
    return Mesh(vertices, place[generator.permutation(mesh.faces)])


@given(seed=st.integers(0, 10_000), cells=st.integers(1, 12))
def test_every_corner_comes_back_within_half_a_step(seed, cells):
    mesh = scrambled(seed, cells)
    compact = CompactMesh.of(mesh)
    back, _ = compact.decoded()

    assert (compact.vertices, compact.faces) == (len(mesh.vertices) - 1, len(mesh.faces))
    before, after = mesh.vertices[mesh.faces], back.vertices[back.faces]
    assert np.abs(before - after).max() <= compact.step_m / 2 * (1 + 1e-9)
    assert compact.step_m == pytest.approx(mesh.extent.max() / 65535)


@given(seed=st.integers(0, 10_000))
def test_values_come_back_within_half_a_step_and_none_stays_none(seed):
    generator = np.random.default_rng(seed)
    mesh = scrambled(seed, 4)
    values = generator.exponential(30, len(mesh.vertices))
    values[generator.random(len(values)) < 0.2] = np.nan
    back, found = CompactMesh.of(mesh, (ScalarColumn("d", values, 0.05),)).decoded()

    before, after = values[mesh.faces], found["d"][back.faces]
    assert (np.isnan(before) == np.isnan(after)).all()
    assert np.nanmax(np.abs(before - after), initial=0.0) <= 0.025 * (1 + 1e-9)


def test_the_bytes_of_one_triangle_are_as_described():
    data = gzip.decompress(base64.b64decode(CompactMesh.of(TRIANGLE).payload))

    # In the order of use: (0, 0.5, 0), (0, 0, 0), (1, 0, 0); a step is 1 / 65535.
    # x goes up by 65535, which is -1 modulo 65536 and folded to 1.
    assert data[:6] == bytes([0, 0, 1]) + bytes(3)
    # y is 32768 steps (half of 65535, to even) and goes back: -32768 twice, folded to 65535.
    assert data[6:12] == bytes([255, 255, 0]) + bytes([255, 255, 0])
    assert data[12:18] == bytes(6)
    # Each corner is the next vertex.
    assert data[18:] == bytes(12)


def test_a_value_beyond_the_last_step_is_the_last_step():
    columns = (ScalarColumn("d", np.array([0.0, 1e9, 3.0]), 0.5),)
    _, found = CompactMesh.of(TRIANGLE, columns).decoded()

    assert sorted(found["d"]) == [0.0, 3.0, 65534 * 0.5]


def test_a_flat_mesh_stays_in_its_plane():
    mesh = Mesh(np.array([[5.0, 5, 5], [5, 6, 5], [6, 5, 5]]), np.array([[0, 1, 2]]))
    back, _ = CompactMesh.of(mesh).decoded()

    assert back.vertices[:, 2] == pytest.approx(5.0)


def test_equal_meshes_give_equal_bytes():
    assert CompactMesh.of(scrambled(3, 6)) == CompactMesh.of(scrambled(3, 6))


@pytest.mark.parametrize(
    ("values", "step", "match"),
    [
        (np.zeros(2), 1.0, "shape"),
        (np.zeros(3), 0.0, "positive step"),
        (np.array([0.0, -1.0, 0.0]), 1.0, "not negative"),
        (np.array([0.0, np.inf, 0.0]), 1.0, "finite"),
    ],
)
def test_a_column_that_does_not_fit_is_refused(values, step, match):
    with pytest.raises(DataError, match=match):
        CompactMesh.of(TRIANGLE, (ScalarColumn("d", values, step),))


def test_a_smooth_surface_takes_few_bytes_a_triangle():
    mesh = square(150)
    wave = Mesh(mesh.vertices + np.outer(np.sin(9 * mesh.vertices[:, 0]), [0, 0, 0.1]), mesh.faces)

    assert len(CompactMesh.of(wave).payload) < 4 * len(mesh.faces)
