"""Normals, filters and the closed surface, on planes and spheres."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.coinciding import open_edges, pieces_of
from harness.geometry.outline import Outline
from harness.geometry.raycast import Raycaster
from harness.geometry.surface import SurfaceIndex
from methods.points.cloud import OrientedPoints
from methods.points.filtering import (
    KeepSettings,
    MeshSettings,
    WorldDepth,
    grid_normals,
    kept_points,
)
from methods.points.meshing import held_to, meshed

CAMERA = RingRig().cameras(108, 192)[1]


def plane_depth(camera: Camera, normal: np.ndarray, offset: float) -> np.ndarray:
    pixels = camera.pixel_centres().reshape(-1, 2)
    rays = camera.ray_directions(pixels)
    depth = (offset - camera.position @ normal) / (rays @ normal)
    return depth.reshape(camera.height, camera.width)


@pytest.mark.parametrize("radius", [1, 2, 4])
@pytest.mark.parametrize("normal", [(0.7, 0.1, 0.7), (0.9, -0.3, 0.3), (0.2, 0.6, 0.8)])
def test_normals_of_a_plane_are_exact_at_any_angle(radius, normal):
    normal = np.array(normal) / np.linalg.norm(normal)
    depth = plane_depth(CAMERA, normal, 0.1)
    mask = np.zeros(depth.shape, bool)
    mask[20:150, 10:90] = True
    found = grid_normals(depth, mask, CAMERA, radius)
    toward = np.sign((CAMERA.position - np.zeros(3)) @ normal)
    np.testing.assert_allclose(found[mask], np.tile(toward * normal, (mask.sum(), 1)), atol=1e-6)
    assert (found[~mask] == 0).all()


def test_a_line_of_pixels_has_no_normal():
    mask = np.zeros((192, 108), bool)
    mask[50, 20:60] = True
    found = grid_normals(np.full(mask.shape, 3.0), mask, CAMERA, 2)
    assert (found == 0).all()


def test_noise_is_averaged_over_the_window(ball):
    rng = np.random.default_rng(0)
    depth = Raycaster(ball).depth(CAMERA)
    mask = np.isfinite(depth)
    true = Raycaster(ball).normals(CAMERA, frame="world")

    def error(radius):
        noisy = np.where(mask, depth * (1 + 0.0005 * rng.standard_normal(depth.shape)), 1.0)
        found = grid_normals(noisy, mask, CAMERA, radius)
        inner = mask & (np.einsum("ijk,ijk->ij", true, found) != 0)
        cosine = np.einsum("ijk,ijk->ij", true, found)[inner]
        return np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean()

    assert error(3) < 0.5 * error(1)


def views_of(mesh, cameras, **changes) -> list[WorldDepth]:
    caster = Raycaster(mesh)
    return [WorldDepth(c, caster.depth(c), caster.coverage(c), **changes) for c in cameras]


def loose(**changes) -> KeepSettings:
    base = {"erode_px": 0, "edge": 10.0, "drop_share": 0.0, "consistency_m": 0.0}
    return KeepSettings(**{**base, "outlier_spacing": 0.0, **changes})


def test_without_filters_every_covered_pixel_becomes_a_point(ball):
    views = views_of(ball, RingRig().cameras(108, 192)[:2])
    kept = kept_points(views, loose())
    assert kept.shares["edges"] == kept.shares["confidence"] == kept.shares["consistency"] == 1.0
    assert min(kept.by_view) > 0.97  # pixels at the rim that the centre's ray misses
    radius = np.linalg.norm(kept.points.positions - ball.bounds.mean(axis=0), axis=1)
    np.testing.assert_allclose(radius, 0.5, atol=1e-3)
    outward = (kept.points.positions - ball.bounds.mean(axis=0)) / radius[:, None]
    cosine = np.einsum("ij,ij->i", outward, kept.points.normals)
    assert np.quantile(cosine, 0.05) > 0.95
    assert cosine.min() > 0


def test_erosion_takes_the_rim_and_nothing_else(ball):
    (view,) = views_of(ball, RingRig().cameras(108, 192)[:1])
    whole, eroded = (kept_points([view], loose(erode_px=n)) for n in (0, 2))
    area, rim = view.covered.sum(), 2 * 2 * np.pi * np.sqrt(view.covered.sum() / np.pi)
    lost = len(whole.points) - len(eroded.points)
    assert lost == pytest.approx(rim, rel=0.25)
    assert eroded.shares["mask"] == pytest.approx(1 - rim / area, abs=0.02)


def test_a_step_in_depth_is_cut_on_both_sides():
    depth = np.full((40, 60), 3.0)
    depth[:, 30:] = 3.2
    view = WorldDepth(RingRig().cameras(60, 40)[0], depth, np.ones((40, 60)))
    kept = kept_points([view], loose(edge=0.01))
    assert kept.shares["edges"] == pytest.approx(58 / 60)


def test_the_least_confident_go_view_by_view():
    depth = np.full((40, 60), 3.0)
    camera = RingRig().cameras(60, 40)[0]
    sure = WorldDepth(camera, depth, np.ones((40, 60)), np.arange(2400.0).reshape(40, 60) + 1000)
    other = WorldDepth(camera, depth, np.ones((40, 60)), np.arange(2400.0).reshape(40, 60))
    kept = kept_points([sure, other], loose(drop_share=0.2))
    assert kept.shares["confidence"] == pytest.approx(0.8, abs=0.001)
    assert kept.by_view[0] == pytest.approx(kept.by_view[1])


def test_points_that_other_views_see_through_go(ball):
    """One view stands 10 cm before the surface; the others see the sphere behind its points."""
    views = views_of(ball, RingRig().cameras(108, 192))
    wrong = WorldDepth(views[0].camera, views[0].depth - 0.1, views[0].coverage)
    kept = kept_points([wrong, *views[1:]], loose(consistency_m=0.02))
    radius = np.linalg.norm(kept.points.positions - ball.bounds.mean(axis=0), axis=1)
    assert kept.by_view[0] < 0.15
    assert min(kept.by_view[2:]) > 0.9
    assert np.quantile(radius, 0.99) < 0.53


def test_opposite_views_do_not_contradict_each_other(ball):
    cameras = RingRig().cameras(108, 192)
    kept = kept_points(views_of(ball, [cameras[0], cameras[4]]), loose(consistency_m=0.02))
    assert kept.shares["consistency"] > 0.995


def test_lone_points_go(ball):
    views = views_of(ball, RingRig().cameras(108, 192)[:1])
    depth = views[0].depth.copy()
    rows, columns = np.nonzero(np.isfinite(depth))
    depth[rows[::900], columns[::900]] -= 0.7
    # With a window of one pixel every lone point still has a normal.
    kept = kept_points([WorldDepth(views[0].camera, depth, views[0].coverage)],
                       loose(outlier_spacing=4.0, normal_px=1))  # fmt: skip
    radius = np.linalg.norm(kept.points.positions - ball.bounds.mean(axis=0), axis=1)
    assert radius.max() < 0.6
    assert kept.shares["outliers"] > 0.95


def test_what_only_one_view_sees_is_no_outlier(ball):
    """Four views of one place are denser than the one of another; both are all there is."""
    near, far = RingRig().cameras(108, 192)[0], RingRig().cameras(108, 192)[4]
    views = views_of(ball, [near, near, near, near, far])
    kept = kept_points(views, loose(outlier_spacing=4.0))
    assert kept.shares["outliers"] > 0.999


def test_nothing_left_names_the_step():
    view = WorldDepth(CAMERA, np.full((192, 108), np.nan), np.ones((192, 108)))
    with pytest.raises(MethodError, match="after the step 'mask'"):
        kept_points([view], KeepSettings())


def test_sides_of_a_thin_sheet_stay_apart_when_thinned():
    rng = np.random.default_rng(0)
    places = np.column_stack([rng.uniform(0, 0.01, (400, 2)), np.zeros(400)])
    sheet = OrientedPoints(
        np.concatenate([places, places - [0, 0, 1e-4]]),
        np.repeat([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], 400, axis=0),
    )
    thin = sheet.thinned(0.005)
    assert len(thin) < 40
    np.testing.assert_allclose(np.abs(thin.normals[:, 2]), 1.0)


def ball_points(ball, share: float = 1.0) -> OrientedPoints:
    """Points all over the upper ``share`` of the sphere."""
    centre = ball.bounds.mean(axis=0)
    rng = np.random.default_rng(1)
    outward = rng.standard_normal((40_000, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    outward = outward[outward[:, 1] > 1 - 2 * share]
    return OrientedPoints(centre + 0.5 * outward, outward)


def test_a_sphere_becomes_one_closed_outward_piece(ball):
    surfaces = meshed(ball_points(ball), MeshSettings(depth=6))
    mesh = surfaces.chosen
    assert surfaces.trimmed is None
    assert open_edges(mesh) == 0
    assert len(pieces_of(mesh.faces, len(mesh.vertices)).face_counts) == 1
    assert mesh.signed_volume == pytest.approx(4 / 3 * np.pi * 0.125, rel=0.01)
    radius = np.linalg.norm(mesh.vertices - ball.bounds.mean(axis=0), axis=1)
    assert np.abs(radius - 0.5).max() < 0.005


def test_where_no_point_is_the_surface_bulges_and_a_trim_opens_it(ball):
    points = ball_points(ball, 0.75)
    whole = meshed(points, MeshSettings(depth=5))
    trimmed = meshed(points, MeshSettings(depth=5, trim=0.1))
    assert whole.margin > 1.25
    assert open_edges(whole.chosen) == 0
    assert open_edges(trimmed.chosen) > 0
    np.testing.assert_array_equal(trimmed.closed.vertices, whole.closed.vertices)
    # A tenth of the vertices, on the bulge's large faces.
    assert 0.1 < trimmed.details()["trimmed_area_share"] < 0.4
    far_closed, far_trimmed = (
        SurfaceIndex(ball).closest(mesh.vertices)[1].max()
        for mesh in (trimmed.closed, trimmed.chosen)
    )
    assert far_trimmed < far_closed


def test_bulges_beyond_the_masks_are_pressed_back(ball):
    """A sphere with 5 cm more below it: masks of the true one take them away, and nothing else."""
    cameras = RingRig().cameras(270, 480)
    caster = Raycaster(ball)
    outlines = [Outline(camera, caster.coverage(camera)) for camera in cameras]
    centre = ball.bounds.mean(axis=0)
    below = np.clip(-(ball.vertices[:, 1] - centre[1]) / 0.5, 0, 1) ** 4
    bulged = Mesh(ball.vertices - np.outer(0.05 * below, [0, 1, 0]), ball.faces)

    held = held_to(bulged, outlines)
    assert bulged.vertices[:, 1].min() == pytest.approx(centre[1] - 0.55)
    assert held.vertices[:, 1].min() == pytest.approx(centre[1] - 0.5, abs=0.008)
    off = SurfaceIndex(ball).closest(held.vertices)[1]
    assert off.max() < 0.015
    assert open_edges(held) == 0
    inside = np.min([outline.distance_m(bulged.vertices) for outline in outlines], axis=0) > 0
    np.testing.assert_array_equal(held.vertices[inside], bulged.vertices[inside])
    assert inside.mean() > 0.5


def test_a_handful_of_points_is_no_surface(ball):
    with pytest.raises(MethodError, match="too few points"):
        meshed(ball_points(ball).chosen(np.arange(40_000) < 20), MeshSettings())
