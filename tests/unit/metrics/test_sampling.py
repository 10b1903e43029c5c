"""Points are uniform by area, and their means are as good as they claim."""

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.geometry.surface import SurfaceIndex, vertex_normals
from metrics.distance import morton_codes, sample_mean, sample_surface

SAMPLINGS = ["independent", "stratified"]


@pytest.fixture(scope="module")
def unequal():
    """Three faces apart, with areas 1 : 2 : 3, a face without area between each two."""
    vertices, faces = [], []
    for i, area in enumerate((1.0, 2.0, 3.0)):
        vertices += [[10 * i, 0, 0], [10 * i + 2 * area, 0, 0], [10 * i, 1, 0]]
        faces += [[3 * i, 3 * i + 1, 3 * i + 2], [3 * i, 3 * i + 1, 3 * i + 1]]
    return SurfaceIndex(Mesh(vertices=np.array(vertices), faces=np.array(faces)))


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_faces_are_drawn_by_their_area(unequal, sampling):
    drawn = np.bincount(sample_surface(unequal, 6000, sampling, 0).faces, minlength=6)
    assert drawn[[1, 3, 5]].tolist() == [0, 0, 0]
    tolerance = 2 if sampling == "stratified" else 4 * np.sqrt(6000 / 4)
    np.testing.assert_allclose(drawn[[0, 2, 4]], [1000, 2000, 3000], atol=tolerance)


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_points_are_uniform_within_a_face(sampling):
    """In each of four congruent parts of a triangle lies a quarter; the mean is the centroid."""
    triangle = Mesh(vertices=np.eye(3), faces=np.array([[0, 1, 2]]))
    samples = sample_surface(SurfaceIndex(triangle), 20_000, sampling, 3)
    np.testing.assert_allclose(samples.points.mean(axis=0), 1 / 3, atol=0.01)
    shares = [*(samples.barycentric > 0.5).mean(axis=0), (samples.barycentric < 0.5).all(1).mean()]
    np.testing.assert_allclose(shares, 0.25, atol=0.015)


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_points_lie_where_they_say(shapes, sampling):
    surface = SurfaceIndex(shapes.figure())
    samples = sample_surface(surface, 1000, sampling, 0)
    corners = surface.mesh.vertices[surface.mesh.faces[samples.faces]]
    np.testing.assert_allclose(
        np.einsum("nk,nkj->nj", samples.barycentric, corners), samples.points, atol=1e-12
    )
    assert samples.barycentric.min() >= 0
    np.testing.assert_allclose(samples.barycentric.sum(axis=1), 1)
    assert surface.closest(samples.points)[1].max() < 1e-6


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("count", [1, 2, 977])
def test_equal_seeds_give_equal_points_and_others_do_not(unequal, sampling, count):
    first, again, other = (sample_surface(unequal, count, sampling, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.points, again.points)
    assert len(first) == count
    assert not np.array_equal(first.points, other.points)


def test_stratified_points_are_spread_evenly(shapes):
    """Of 2000 points 20 fall into each of 100 cells: more or less by chance, or nearly so."""
    surface = SurfaceIndex(shapes.square())
    variance = {}
    for sampling in SAMPLINGS:
        x, y, _ = sample_surface(surface, 2000, sampling, 0).points.T
        cells, *_ = np.histogram2d(x, y, bins=10, range=[[-0.5, 0.5]] * 2)
        variance[sampling] = cells.var()
    assert 12 < variance["independent"] < 30
    assert variance["stratified"] < 10


def test_the_last_face_may_be_without_area():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    surface = SurfaceIndex(Mesh(vertices=vertices, faces=np.array([[0, 1, 2], [0, 1, 1]])))
    assert set(sample_surface(surface, 5000, "stratified", 0).faces) == {0}


def slow_morton_code(cell):
    """The bits of x, y and z in turn, from the lowest."""
    return sum(((int(cell[i % 3]) >> (i // 3)) & 1) << i for i in range(63))


def testmorton_codes_agree_with_the_slow_twin():
    points = np.random.default_rng(0).random((200, 3))
    points[:2] = [[0, 0, 0], [1, 1, 1]]
    cells = np.floor(points * (2**21 - 1)).astype(int)
    assert morton_codes(points).tolist() == [slow_morton_code(cell) for cell in cells]


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_the_standard_error_is_that_of_repeated_samples(shapes, sampling):
    """Stratified means err several times less; their error is never understated."""
    surface = SurfaceIndex(shapes.sphere(level=3))
    means = [
        sample_mean(sample_surface(surface, 400, sampling, seed).points[:, 0] ** 2, "mm", sampling)
        for seed in range(150)
    ]
    spread = np.std([mean.value for mean in means])
    stated = np.mean([mean.standard_error for mean in means])
    assert np.mean([mean.value for mean in means]) == pytest.approx(1 / 3, abs=0.01)
    assert 0.85 < stated / spread < (1.15 if sampling == "independent" else 2.5)
    plain = np.std(vertex_normals(surface.mesh)[:, 0] ** 2) / np.sqrt(400)
    assert (spread < 0.35 * plain) == (sampling == "stratified")


def test_the_mean_of_one_point():
    assert sample_mean(np.array([3.0]), "mm", "independent").standard_error == 0
