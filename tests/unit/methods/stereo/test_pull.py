"""Surfaces pulled to points of known places, and how far points are believed."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.mesh import Mesh
from methods.stereo.membrane import Neighbourhood, agreement
from methods.stereo.pull import StereoPoints, pull
from methods.stereo.settings import PullRound, StereoSettings
from tests.unit.methods.stereo.conftest import RADIUS

ROUNDS = StereoSettings().pulls


def kept(mesh: Mesh, _step_m: float) -> Mesh:
    return mesh


def on_sphere(count: int, radius_m, seed: int = 0, views: int = 8) -> StereoPoints:
    """Points spread over a sphere; ``radius_m`` a number or (count,) by point."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    radii = np.broadcast_to(radius_m, count)[:, None]
    return StereoPoints(directions * radii, directions, np.ones(count), np.arange(count) % views)


def off_mm(mesh: Mesh) -> np.ndarray:
    return 1e3 * np.abs(np.linalg.norm(mesh.vertices, axis=1) - RADIUS)


def scaled(mesh: Mesh, by_m: float) -> Mesh:
    return Mesh(mesh.vertices * (RADIUS + by_m) / RADIUS, mesh.faces)


@pytest.mark.parametrize("start_m", [0.005, -0.005, 0.03])
def test_a_displaced_sphere_comes_back(sphere, start_m):
    pulled = pull(scaled(sphere, start_m), on_sphere(60_000, RADIUS), ROUNDS, kept)
    assert np.quantile(off_mm(pulled.mesh), 0.99) < 0.2
    assert pulled.rounds[0].believed > 0.99
    assert pulled.rounds[0].vertices > 0.99


def test_points_with_errors_are_averaged(sphere):
    rng = np.random.default_rng(1)
    points = on_sphere(60_000, RADIUS + rng.normal(0, 0.001, 60_000))
    pulled = pull(scaled(sphere, 0.005), points, ROUNDS, kept)
    assert np.sqrt((off_mm(pulled.mesh) ** 2).mean()) < 0.35


def test_wild_points_do_not_pull(sphere):
    rng = np.random.default_rng(2)
    radii = np.full(60_000, RADIUS)
    radii[::5] += rng.uniform(-0.02, 0.02, 12_000)
    pulled = pull(scaled(sphere, 0.005), on_sphere(60_000, radii), ROUNDS, kept)
    assert np.quantile(off_mm(pulled.mesh), 0.95) < 1.0


@pytest.mark.parametrize(("radius_m", "depth_mm"), [(0.015, 0.0), (0.02, 0.0), (0.04, 12.0)])
def test_a_small_island_of_points_does_not_pull_and_a_large_one_does(sphere, radius_m, depth_mm):
    """All views agree on points that lie 12 mm behind all around them, on 7, 12 and 50 cm2."""
    points = on_sphere(60_000, RADIUS)
    island = np.arccos(points.normals[:, 2]) < radius_m / RADIUS
    radii = np.where(island, RADIUS - 0.012, RADIUS)
    pulled = pull(sphere, on_sphere(60_000, radii), ROUNDS[1:], kept)
    pole = np.hypot(*sphere.vertices[:, :2].T) < 0.5 * radius_m
    pole &= sphere.vertices[:, 2] > 0
    assert pole.sum() >= 4
    assert np.abs(off_mm(pulled.mesh)[pole].mean() - depth_mm) < 0.5


def test_patches_are_told_apart_by_their_values(sphere):
    around = Neighbourhood(sphere)
    north = sphere.vertices[:, 2] > 0.5 * RADIUS
    equator = np.abs(sphere.vertices[:, 2]) < 0.1 * RADIUS
    areas = around.patch_areas_m2(np.where(north, 1.0, 0.0), ~equator, 0.5)
    cap, whole = np.pi * RADIUS**2, 4.0 * np.pi * RADIUS**2
    assert np.all(areas[equator] == 0)
    assert areas[north] == pytest.approx(cap, rel=0.05)
    assert areas[sphere.vertices[:, 2] < -0.1 * RADIUS] == pytest.approx(0.45 * whole, rel=0.05)


def test_views_that_contradict_each_other_do_not_pull(sphere):
    """Even views say 8 mm outside, odd ones 8 mm inside: no offset predicts the other's."""
    radii = RADIUS + np.where(np.arange(60_000) % 2 == 0, 0.003, -0.003)
    pulled = pull(sphere, on_sphere(60_000, radii), ROUNDS[2:], kept)
    assert np.quantile(off_mm(pulled.mesh), 0.95) < 0.6
    assert pulled.rounds[0].believed < 0.3


def test_random_points_never_make_it_worse(sphere):
    """Views without anything in common: each vertex of each view's own has another offset."""
    rng = np.random.default_rng(3)
    points = on_sphere(60_000, RADIUS + rng.uniform(-0.008, 0.008, 60_000))
    pulled = pull(scaled(sphere, 0.001), points, ROUNDS, kept)
    assert np.sqrt((off_mm(pulled.mesh) ** 2).mean()) < 1.3


def test_what_no_point_tells_follows_its_neighbours_less_and_less(sphere):
    points = on_sphere(60_000, RADIUS)
    front = points.chosen(points.positions[:, 2] > 0)
    pulled = pull(scaled(sphere, 0.005), front, ROUNDS[3:], kept)
    z, off = pulled.mesh.vertices[:, 2], off_mm(pulled.mesh)
    assert np.quantile(off[z > 0.02], 0.95) < 0.3
    beside, behind = off[(z < -0.02) & (z > -0.06)].mean(), off[z < -0.13].mean()
    assert 0.5 < beside < behind < 5.0


def test_no_points_leave_the_mesh_where_it_is(sphere):
    pulled = pull(sphere, on_sphere(8, RADIUS).chosen(np.zeros(8, bool)), ROUNDS, kept)
    np.testing.assert_array_equal(pulled.mesh.vertices, sphere.vertices)


def test_remeshing_follows_each_round_but_the_last(sphere):
    asked = []

    def noted(mesh: Mesh, step_m: float) -> Mesh:
        asked.append(step_m)
        return mesh

    pull(sphere, on_sphere(5000, RADIUS), ROUNDS, noted)
    assert asked == [0.006, 0.005, 0.005]


def test_agreement_is_the_weight_of_the_truth(sphere):
    """Truth of 2 mm, errors of 1 mm a group: the mean of two has the share 4 / (4 + 0.5)."""
    around, rng = Neighbourhood(sphere), np.random.default_rng(4)
    truth = rng.normal(0, 0.002, len(sphere.vertices))
    first, second = (truth + rng.normal(0, 0.001, len(truth)) for _ in range(2))
    found = agreement(first, second, around)
    assert found.overall == pytest.approx(4 / 4.5, abs=0.03)
    assert found.error_m == pytest.approx(0.001, rel=0.1)
    assert found.compared == 1.0


def test_groups_that_say_nothing_of_each_other_are_not_believed(sphere):
    around, rng = Neighbourhood(sphere), np.random.default_rng(5)
    first, second = rng.normal(0, 0.003, (2, len(sphere.vertices)))
    assert agreement(first, second, around).overall < 0.15
    nothing = agreement(first, np.full(len(first), np.nan), around)
    assert nothing.overall == 0.0
    assert not nothing.share.any()


def test_a_motion_is_smooth_and_meets_what_is_wanted(sphere):
    around = Neighbourhood(sphere)
    wanted = np.full(len(sphere.vertices), 0.004)
    motion = around.motion(wanted, np.ones(len(wanted)), 0.002)
    np.testing.assert_allclose(motion, 0.004 / 1.001, rtol=1e-6)


def test_rounds_without_reach_meet_no_point(sphere):
    rounds = (PullRound(0.001, 0.001, 0.002, 0.0),)
    pulled = pull(scaled(sphere, 0.005), on_sphere(5000, RADIUS), rounds, kept)
    assert pulled.rounds[0].vertices == 0.0
