"""What holds for every pair of meshes, whatever they look like."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from harness.core.mesh import Mesh
from harness.core.settings import MetricProtocol
from harness.geometry.surface import SurfaceIndex, vertex_normals
from metrics.distance import (
    mean_of_directions,
    nearest_samples,
    nearest_surface_mm,
    sample_mean,
    sample_surface,
)
from metrics.normals import angles_deg
from metrics.score import f_scores, score

SEEDS = st.integers(0, 2**32 - 1)
FINITE = st.floats(-1e3, 1e3, allow_subnormal=False)
DISTANCES = arrays(np.float64, st.integers(1, 50), elements=st.floats(0, 100))


def soup(seed, vertices=12, faces=16):
    """Triangles at random, some of them without area."""
    random = np.random.default_rng(seed)
    corners = random.integers(0, vertices, (faces, 3))
    corners[0] = 0, 1, 2
    return Mesh(vertices=random.normal(size=(vertices, 3)), faces=corners)


def rotation(seed):
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


@given(SEEDS, SEEDS, arrays(np.float64, 3, elements=FINITE), st.floats(0.1, 10))
def test_distances_follow_motion_and_scale(mesh_seed, turn_seed, offset, scale):
    mesh, turn = soup(mesh_seed), rotation(turn_seed)
    points = np.random.default_rng(mesh_seed).normal(size=(50, 3)) * 3
    moved = Mesh(vertices=scale * mesh.vertices @ turn.T + offset, faces=mesh.faces)
    _, here = nearest_surface_mm(points, SurfaceIndex(mesh))
    _, there = nearest_surface_mm(scale * points @ turn.T + offset, SurfaceIndex(moved))
    np.testing.assert_allclose(there, scale * here, atol=0.02 * scale)


@given(SEEDS)
def test_the_order_of_faces_does_not_matter(seed):
    mesh = soup(seed)
    shuffled = Mesh(
        vertices=mesh.vertices, faces=np.random.default_rng(seed).permutation(mesh.faces)
    )
    points = np.random.default_rng(seed).normal(size=(50, 3))
    _, first = nearest_surface_mm(points, SurfaceIndex(mesh))
    _, second = nearest_surface_mm(points, SurfaceIndex(shuffled))
    np.testing.assert_allclose(first, second, atol=1e-3)
    np.testing.assert_allclose(vertex_normals(mesh), vertex_normals(shuffled), atol=1e-9)


@given(SEEDS)
def test_a_surface_is_no_farther_than_its_vertices_and_its_own_points_are_on_it(seed):
    mesh = soup(seed)
    surface = SurfaceIndex(mesh)
    used = mesh.vertices[np.unique(mesh.faces[surface.face_areas > 0])]
    points = np.random.default_rng(seed).normal(size=(20, 3)) * 2
    _, distances = surface.closest(points)
    to_vertices = np.linalg.norm(points[:, None] - used[None], axis=2).min(axis=1)
    assert (distances <= to_vertices + 1e-6).all()
    # In slivers metres long the search is off by up to a tenth of a millimetre.
    assert surface.closest(sample_surface(surface, 50, "stratified", seed).points)[1].max() < 1e-4


@given(SEEDS, st.sampled_from(["independent", "stratified"]))
def test_interpolated_normals_are_always_unit_vectors(seed, sampling):
    surface = SurfaceIndex(soup(seed))
    normals = surface.normals(sample_surface(surface, 100, sampling, seed))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)


@given(SEEDS)
def test_every_number_of_a_score_is_finite_and_in_range(seed):
    truth = soup(seed)
    noise = np.random.default_rng(seed + 1).normal(scale=0.1, size=truth.vertices.shape)
    predicted = Mesh(vertices=truth.vertices + noise, faces=truth.faces)
    protocol = MetricProtocol("small", 1, 300, "independent", "sample-to-sample")
    result = score(predicted, truth, protocol)
    values = {name: metric.value for name, metric in result.metrics.items()}
    assert all(np.isfinite(value) and value >= 0 for value in values.values())
    assert values["normal_error"] <= 180
    # A sample is never nearer than the surface that it lies on.
    assert values["chamfer"] >= (values["p2s_accuracy"] + values["p2s_completeness"]) / 2 - 1e-3
    assert values["p2s_accuracy"] <= result.diagnostics.predicted_to_truth.max_sampled_mm


@given(SEEDS)
def test_chamfer_does_not_care_which_comes_first(seed):
    random = np.random.default_rng(seed)
    first, second = random.normal(size=(40, 3)), random.normal(size=(30, 3))
    ways = [
        sample_mean(nearest_samples(*pair)[0], "m", "independent")
        for pair in ((first, second), (second, first))
    ]
    there, back = (mean_of_directions(*each, together=True) for each in (ways, ways[::-1]))
    assert there.value == pytest.approx(back.value)
    assert there.standard_error == pytest.approx(back.standard_error)


@given(SEEDS, st.floats(1e-3, 1e3))
def test_angles_ignore_length_and_order_and_complete_each_other(seed, length):
    first, second = np.random.default_rng(seed).normal(size=(2, 20, 3))
    angles = angles_deg(first, second)
    assert ((angles >= 0) & (angles <= 180)).all()
    np.testing.assert_allclose(angles_deg(second, first * length), angles)
    np.testing.assert_allclose(angles_deg(first, -second), 180 - angles, atol=1e-9)


@given(DISTANCES, DISTANCES)
def test_f_scores_are_shares_that_grow_with_the_threshold(accuracy, completeness):
    found = [f_scores(accuracy, completeness)[f"{t}_mm"] for t in (5, 10, 20, 50)]
    for entry in found:
        low, high = sorted((entry.precision, entry.recall))
        assert 0 <= low <= entry.f + 1e-12
        assert entry.f <= high + 1e-12 <= 1 + 1e-12 or low == 0
    for name in ("precision", "recall", "f"):
        shares = [getattr(entry, name) for entry in found]
        assert shares == sorted(shares)


@given(DISTANCES, FINITE, st.sampled_from(["independent", "stratified"]))
def test_the_standard_error_ignores_a_shift_and_vanishes_without_spread(values, shift, sampling):
    first, second = (sample_mean(v, "mm", sampling) for v in (values, values + shift))
    assert second.value == pytest.approx(first.value + shift, abs=1e-9)
    assert second.standard_error == pytest.approx(first.standard_error, abs=1e-9)
    assert sample_mean(np.full(9, shift), "mm", sampling).standard_error < 1e-9
