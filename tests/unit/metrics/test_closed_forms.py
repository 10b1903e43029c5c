"""Surfaces whose distances and angles are known: the metrics have to give them."""

import dataclasses

import numpy as np
import pytest

from harness.core.records import FScore
from metrics.score import score


def values(result):
    return {name: metric.value for name, metric in result.metrics.items()}


def assert_within_error(metric, expected, facets=0.0):
    """Equal up to four standard errors and what the facets of the mesh take away."""
    assert abs(metric.value - expected) <= 4 * metric.standard_error + facets, metric


def test_a_perfect_copy(shapes, exact):
    result = score(shapes.sphere(), shapes.sphere(), exact)
    found = values(result)
    assert found["p2s_accuracy"] < 1e-4
    assert found["p2s_completeness"] < 1e-4
    assert found["chamfer"] < 1e-4
    assert found["normal_error"] < 1e-3
    assert result.diagnostics.f_score["5_mm"] == FScore(precision=1, recall=1, f=1)


def test_a_perfect_copy_scores_the_sampling_floor(shapes, mexecon):
    result = score(shapes.sphere(), shapes.sphere(), mexecon)
    chamfer = result.metrics["chamfer"]
    assert chamfer.value == chamfer.floor
    assert_within_error(chamfer, 500 * np.sqrt(4 * np.pi / 30_000))
    assert result.metrics["p2s_accuracy"].value < 1e-4
    assert result.metrics["p2s_accuracy"].floor == 0


def test_permuted_weights_give_even_a_perfect_copy_an_angle(shapes, mexecon):
    """That of the normals within a face: it halves with the length of the edges."""
    right = dataclasses.replace(mexecon, normal_weights="barycentric")
    coarse, fine = (
        values(score(shapes.sphere(level=level), shapes.sphere(level=level), mexecon))
        for level in (4, 5)
    )
    assert coarse["normal_error"] == pytest.approx(2 * fine["normal_error"], rel=0.02)
    assert 1.5 < fine["normal_error"] < 1.7
    found = values(score(shapes.sphere(level=4), shapes.sphere(level=4), right))
    assert found["normal_error"] < 1e-3


@pytest.mark.parametrize(("protocol", "angle_deg"), [("mexecon", 0.9), ("exact", 0.05)])
def test_concentric_spheres(shapes, protocol, angle_deg, request):
    result = score(
        shapes.sphere(1.1, level=6), shapes.sphere(1.0, level=6), request.getfixturevalue(protocol)
    )
    assert result.metrics["p2s_accuracy"].value == pytest.approx(100, abs=0.05)
    assert result.metrics["p2s_completeness"].value == pytest.approx(100, abs=0.05)
    assert result.metrics["normal_error"].value < angle_deg
    assert result.diagnostics.f_score["50_mm"].f == 0
    assert result.metrics["chamfer"].value >= 99.9


def test_a_shifted_sphere(shapes, exact):
    """Distances are uniform from 0 to the shift; the angle grows with them."""
    shift = 0.5
    result = score(shapes.sphere(1, (shift, 0, 0), 6), shapes.sphere(1, level=6), exact)
    assert_within_error(result.metrics["p2s_accuracy"], 250, facets=0.1)
    assert_within_error(result.metrics["p2s_completeness"], 250, facets=0.1)
    assert_within_error(result.metrics["chamfer"], 250, facets=0.1)
    assert_within_error(result.metrics["normal_error"], 22.5, facets=0.02)
    for direction in ("predicted_to_truth", "truth_to_predicted"):
        found = getattr(result.diagnostics, direction)
        for q in (50, 90, 95, 99):
            assert getattr(found, f"p{q}_mm") == pytest.approx(5 * q, abs=1)
        assert found.max_sampled_mm == pytest.approx(500, abs=1)
    assert result.diagnostics.f_score["50_mm"].f == pytest.approx(0.1, abs=0.005)


def test_parallel_squares(shapes, exact):
    found = values(score(shapes.moved(shapes.square(), (0, 0, 0.05)), shapes.square(), exact))
    assert found["p2s_accuracy"] == pytest.approx(50, abs=1e-3)
    assert found["p2s_completeness"] == pytest.approx(50, abs=1e-3)
    assert found["chamfer"] == pytest.approx(50, abs=1e-3)
    assert found["normal_error"] == pytest.approx(0, abs=1e-6)


def test_a_square_facing_away(shapes, exact):
    away = shapes.flipped(shapes.moved(shapes.square(), (0, 0, 0.05)))
    result = score(away, shapes.square(), exact)
    assert result.metrics["normal_error"].value == pytest.approx(180)
    assert result.diagnostics.normals.unoriented_mean_deg == pytest.approx(0, abs=1e-6)
    assert result.diagnostics.normals.share_over_90 == 1
    assert "100% of the predicted normals point away" in result.warnings[0]


def test_a_square_shifted_in_its_plane_as_well(shapes, exact):
    result = score(shapes.moved(shapes.square(), (0.2, 0, 0.05)), shapes.square(), exact)
    assert_within_error(result.metrics["p2s_accuracy"], 63.2339, facets=1e-3)
    assert_within_error(result.metrics["p2s_completeness"], 63.2339, facets=1e-3)
    assert result.diagnostics.predicted_to_truth.max_sampled_mm == pytest.approx(206.155, abs=1)


def test_a_square_turned_about_its_middle(shapes, exact):
    turned = shapes.moved(shapes.square(), matrix=shapes.rotation(0, 30))
    result = score(turned, shapes.square(), exact)
    assert_within_error(result.metrics["p2s_accuracy"], 125)
    assert_within_error(result.metrics["p2s_completeness"], 125)
    assert result.metrics["normal_error"].value == pytest.approx(30)
    assert result.diagnostics.predicted_to_truth.max_sampled_mm == pytest.approx(250, abs=1)


def test_a_shifted_cube(shapes, exact):
    cube = shapes.box([0, 0, 0], [1, 1, 1], level=3)
    result = score(shapes.moved(cube, (0.1, 0, 0)), cube, exact)
    assert_within_error(result.metrics["p2s_accuracy"], 33.5556)
    assert_within_error(result.metrics["p2s_completeness"], 33.5556)


def test_half_a_sphere_pins_the_directions(shapes, exact):
    """What is there is exact; what is missing is punished by the completeness alone."""
    whole = shapes.sphere(level=6)
    half = whole.submesh(whole.vertices[whole.faces][..., 2].mean(axis=1) > 0)
    result = score(half, whole, exact)
    assert result.metrics["p2s_accuracy"].value < 1e-3
    assert_within_error(result.metrics["p2s_completeness"], 2e3 * (np.sqrt(2) - 1) / 3, facets=0.2)
    assert result.diagnostics.meshes["predicted"].inverted is None


def test_a_limb_displaced_by_its_own_radius(shapes, exact):
    """An open cylinder, shifted across its axis: 0.5987 radii and 45 degrees."""
    around, along, radius = 256, 8, 0.06
    angle, height = np.meshgrid(
        np.linspace(0, 2 * np.pi, around, endpoint=False), np.linspace(0, 1, along), indexing="xy"
    )
    vertices = np.stack([radius * np.cos(angle), height, radius * np.sin(angle)], axis=-1)
    i, j = np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.concatenate(
        [np.stack([a, a + around, b], -1), np.stack([b, a + around, b + around], -1)]
    )
    mesh = dataclasses.replace(
        shapes.square(), vertices=vertices.reshape(-1, 3), faces=faces.reshape(-1, 3)
    )
    result = score(shapes.moved(mesh, (radius, 0, 0)), mesh, exact)
    assert_within_error(result.metrics["p2s_accuracy"], 598.7 * radius, facets=0.02)
    assert_within_error(result.metrics["normal_error"], 45, facets=0.1)


def test_scaling_both_meshes_scales_distances_alone(shapes, mexecon):
    small = values(score(shapes.sphere(1.1, level=3), shapes.sphere(1, level=3), mexecon))
    result = score(shapes.sphere(1100, level=3), shapes.sphere(1000, level=3), mexecon)
    large = values(result)
    for name in ("chamfer", "p2s_accuracy", "p2s_completeness"):
        assert large[name] == pytest.approx(1000 * small[name], rel=1e-6)
    assert large["normal_error"] == pytest.approx(small["normal_error"], rel=1e-4)
    assert "unlike a person in metres" in result.warnings[0]


def test_swapping_the_meshes_swaps_the_directions(shapes, exact):
    first, second = shapes.figure(), shapes.moved(shapes.figure(), (0.03, -0.02, 0.01))
    there, back = score(first, second, exact), score(second, first, exact)
    assert_within_error(there.metrics["chamfer"], back.metrics["chamfer"].value, facets=0.02)
    assert_within_error(
        there.metrics["p2s_accuracy"], back.metrics["p2s_completeness"].value, facets=0.02
    )
    assert there.diagnostics.normals.truth_to_predicted_mean_deg == pytest.approx(
        back.metrics["normal_error"].value, abs=0.3
    )


def test_moving_both_meshes_changes_nothing(shapes, mexecon):
    """Also one kilometre away, where float32 alone would be 0.1 mm wrong."""
    first, second = shapes.figure(), shapes.moved(shapes.figure(), (0.03, -0.02, 0.01))
    matrix = shapes.rotation(0, 40) @ shapes.rotation(1, 70)
    far = [shapes.moved(mesh, (1000, -1000, 500), matrix) for mesh in (first, second)]
    rules = dataclasses.replace(mexecon, normal_weights="barycentric")
    here, there = values(score(first, second, rules)), values(score(*far, rules))
    for name in ("chamfer", "p2s_accuracy", "p2s_completeness"):
        assert there[name] == pytest.approx(here[name], abs=1e-3)
    # A few closest points lie on an edge and fall to the face on its other side.
    assert there["normal_error"] == pytest.approx(here["normal_error"], abs=0.1)


def test_finer_triangles_on_the_same_surface_change_nothing(shapes, exact):
    """Unweighted faces or vertices would pull the mean to where the triangles are small."""
    truth = shapes.moved(shapes.square(), (0.1, 0.1, 0.05))
    coarse = shapes.square()
    left = coarse.vertices[coarse.faces][..., 0].mean(axis=1) < 0
    finer = shapes.joined(coarse.submesh(~left), shapes.subdivided(coarse.submesh(left), 3))
    first, second = score(coarse, truth, exact), score(finer, truth, exact)
    for name in first.metrics:
        assert_within_error(second.metrics[name], first.metrics[name].value, facets=0.02)


def test_an_inside_out_mesh_is_named(shapes, exact):
    result = score(shapes.flipped(shapes.sphere(1.01)), shapes.sphere(), exact)
    assert result.metrics["normal_error"].value == pytest.approx(180, abs=0.1)
    assert result.metrics["p2s_accuracy"].value == pytest.approx(10, abs=0.05)
    assert result.diagnostics.meshes["predicted"].inverted is True
    assert result.diagnostics.meshes["truth"].inverted is False
    assert result.warnings == (
        "the predicted mesh is inside out: its faces are wound clockwise seen from outside",
    )
