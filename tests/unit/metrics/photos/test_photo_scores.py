"""A ball photographed exactly, and what its own mesh and wrong ones score in the photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from harness.core.artifacts import NormalMaps
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.photo_scores import PhotoScores
from harness.core.rigs import RingRig
from harness.core.typed_json import from_json, to_json
from harness.geometry.images import linear_from_srgb, srgb_from_linear
from harness.geometry.photo import Photo
from harness.geometry.raycast import Raycaster
from metrics.photos import in_exposure_of, map_agreement, photo_scores

CAMERAS = RingRig(views=8).cameras(180, 320)
RADIUS = 0.45


def ball(radius=RADIUS, centre=(0.0, 0.0, 0.0)) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    return Mesh(made.vertices + np.asarray(centre), made.faces, source="ball")


def photos_of(mesh: Mesh, exposures: Sequence[float] = (1.0,) * 8) -> list[Photo]:
    """Exact photos of a mesh whose colour is a texture that fills space."""
    caster = Raycaster(mesh)
    taken = []
    for camera, exposure in zip(CAMERAS, exposures, strict=True):
        hits = caster.cast(camera)
        points = hits.interpolate(mesh.vertices, mesh.faces)
        colour = 0.5 + 0.25 * np.sin(points @ np.array([[14, 6, 9], [5, 16, 7], [9, 4, 15.0]]))
        colour = srgb_from_linear(np.clip(exposure * linear_from_srgb(colour), 0, 1))
        rgba = np.dstack([np.where(hits.mask[..., None], colour, 0), hits.mask])
        taken.append(Photo(np.round(255 * rgba).astype(np.uint8), camera, Path("made")))
    return taken


def scores_of(mesh: Mesh, photos: Sequence[Photo]) -> PhotoScores:
    """With vertices as far apart as two pixels of these small photos."""
    return photo_scores(mesh, photos, edge_m=0.02)


@pytest.fixture(scope="module")
def photos() -> list[Photo]:
    return photos_of(ball())


@pytest.fixture(scope="module")
def own(photos) -> PhotoScores:
    return scores_of(ball(), photos)


def test_the_true_mesh_looks_like_its_photos(own: PhotoScores):
    assert own.worst_iou == 1.0
    assert own.psnr_db is not None
    assert own.psnr_db > 33
    assert own.ssim is not None
    assert own.ssim > 0.97
    assert own.soundness.watertight
    assert own.seen_share > 0.85
    assert [view.view for view in own.views if view.held_out] == [0, 2, 4, 6]
    assert own.held_out_psnr_db is not None
    assert 27 < own.held_out_psnr_db <= own.psnr_db


def test_a_mesh_beside_the_truth_overlaps_as_two_discs(photos: list[Photo]):
    shift = 0.1
    moved = scores_of(ball(centre=(shift, 0, 0)), photos)
    # Seen from the front, two equal circles whose centres are apart by so many radii.
    half = shift / RADIUS / 2
    both = (2 * np.arccos(half) - 2 * half * np.sqrt(1 - half**2)) / np.pi
    assert moved.views[0].silhouette_iou == pytest.approx(both / (2 - both), abs=0.02)
    # From the side it lies nearer, and is larger by what perspective says.
    assert moved.views[2].silhouette_iou == pytest.approx((2.9 / 3.0) ** 2, abs=0.015)
    assert moved.worst_iou == min(view.silhouette_iou for view in moved.views)


def test_wrong_geometry_looks_worse_most_of_all_in_a_photo_that_was_left_out(
    photos: list[Photo], own: PhotoScores
):
    smaller = scores_of(ball(0.85 * RADIUS), photos)
    assert smaller.mean_iou == pytest.approx(0.85**2, abs=0.01)
    assert smaller.held_out_psnr_db is not None
    assert own.held_out_psnr_db is not None
    assert own.psnr_db is not None
    assert smaller.psnr_db is not None
    assert smaller.held_out_psnr_db < own.held_out_psnr_db - 5
    assert own.psnr_db - smaller.psnr_db < own.held_out_psnr_db - smaller.held_out_psnr_db


def test_exposures_that_differ_cost_little(own: PhotoScores):
    uneven = scores_of(ball(), photos_of(ball(), [1.0, 0.6] * 4))
    assert own.psnr_db is not None
    assert uneven.psnr_db == pytest.approx(own.psnr_db, abs=1.5)
    colours = np.random.default_rng(1).uniform(0.3, 0.6, (50, 3))
    darker = srgb_from_linear(linear_from_srgb(colours) * (0.5, 0.8, 1.0))
    np.testing.assert_allclose(in_exposure_of(colours, darker), darker, atol=1e-12)


@pytest.mark.parametrize(("count", "left_out"), [(1, []), (2, []), (3, [0, 1, 2])])
def test_few_photos_leave_none_out(photos: list[Photo], count: int, left_out: list[int]):
    found = scores_of(ball(), photos[:count])
    assert [view.view for view in found.views if view.held_out] == left_out
    assert (found.held_out_psnr_db is None) == (not left_out)


def test_maps_that_are_turned_by_an_angle_disagree_by_it():
    mesh = ball()
    camera = CAMERAS[1]
    own = Raycaster(mesh).normals(camera)
    mask = own.any(axis=2)
    angle = np.radians(10.0)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    exact = NormalMaps(1, camera, mask, own, -own, own, -own)
    (found,) = map_agreement(mesh, [exact])
    assert (found.view, found.errors.n) == (1, mask.sum())
    assert found.errors.mean_deg == pytest.approx(0.0, abs=1e-4)
    (found,) = map_agreement(mesh, [replace(exact, front=own @ turn.T)])
    # A turn about the viewing axis moves each normal by what lies across that axis.
    across = np.hypot(own[mask][:, 0], own[mask][:, 1])
    expected = 2 * np.degrees(np.arcsin(across * np.sin(angle / 2)))
    assert found.errors.mean_deg == pytest.approx(expected.mean(), abs=1e-4)


def test_scores_are_read_back_equal_and_no_photo_is_refused(own: PhotoScores):
    assert from_json(PhotoScores, to_json(own), "scores", "scores of photos") == own
    with pytest.raises(DataError, match="no photos"):
        scores_of(ball(), [])
