"""The visual hull of known silhouettes."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, image_name
from harness.core.errors import HarnessError, MethodError
from harness.core.mesh import Mesh
from harness.core.protocols import Context
from harness.core.rigs import RingRig
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from methods.hull import HullSettings, hull, hull8
from tests.spheres import icosphere

RADIUS = 0.3


def photograph(mesh: Mesh, folder: Path, views: int = 8) -> Capture:
    """White RGBA pictures whose alpha is the exact coverage."""
    cameras = RingRig(views=views).cameras(270, 480)
    caster = Raycaster(mesh)
    for view, camera in enumerate(cameras):
        alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
        rgba = np.dstack([np.full((*alpha.shape, 3), 255, np.uint8), alpha])
        save_png(folder / image_name(view), rgba)
    return Capture("toy", "s", "r", "k", folder, cameras)


@pytest.fixture
def context(tmp_path: Path) -> Context:
    return Context(0, tmp_path, lambda _: contextlib.nullcontext())


def test_the_hull_of_a_sphere_touches_it_and_contains_it(tmp_path, context):
    fine = hull8.configured({"hull.voxel_m": "0.006"})
    result = fine.reconstruct(photograph(icosphere(RADIUS), tmp_path), context)
    mesh = result.mesh
    distance = np.linalg.norm(mesh.vertices, axis=1)
    # A camera at distance d touches the equator at yaw ± arccos(r / d): of eight cameras that is
    # a polygon of sixteen tangents, and its farthest corner lies in the middle of the wider gap.
    pixel_m = 3.0 / mesh_focal()
    touch_deg = np.degrees(np.arccos(RADIUS / 3.0))
    gap = np.radians(max((2 * touch_deg) % 45, 45 - (2 * touch_deg) % 45))
    assert distance.min() > RADIUS - pixel_m
    equator = np.abs(mesh.vertices[:, 1]) < 0.01
    assert distance[equator].max() == pytest.approx(RADIUS / np.cos(gap / 2), abs=pixel_m / 2)
    assert mesh.signed_volume > 4 / 3 * np.pi * RADIUS**3
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, uses = np.unique(edges, axis=0, return_counts=True)
    assert (uses == 2).all(), "the hull is closed"


@pytest.mark.parametrize("views", [3, 8, 13])
def test_more_views_carve_more(tmp_path, context, views):
    coarse = hull.configured({"hull.voxel_m": "0.01"})
    capture = photograph(icosphere(RADIUS), tmp_path / str(views), views)
    volume = coarse.reconstruct(capture, context).mesh.signed_volume
    # Seen level from all round, what is left is round and about as wide as the tangents' polygon:
    # each camera gives two, and what they enclose is at most that of ``views`` evenly spread ones.
    sphere = 4 / 3 * np.pi * RADIUS**3
    widest = views / np.pi * np.tan(np.pi / views)
    assert 1.0 < volume / sphere < 1.35 * widest


def test_all_of_eight_views_are_those_of_hull8(tmp_path, context):
    capture = photograph(icosphere(RADIUS), tmp_path)
    coarse = {"hull.voxel_m": "0.012"}
    first, second = (
        method.configured(coarse).reconstruct(capture, context).mesh for method in (hull, hull8)
    )
    np.testing.assert_array_equal(first.vertices, second.vertices)


def test_one_view_bounds_no_volume(tmp_path, context):
    with pytest.raises(MethodError, match="hull needs photos from more than one side"):
        hull.reconstruct(photograph(icosphere(RADIUS), tmp_path, views=1), context)


def test_outlines_that_nearly_meet_are_told_to_have_nothing_in_common(tmp_path, context):
    ball = icosphere(0.05)
    aside = Mesh(ball.vertices + np.array([0.0, 0.13, 0.0]), ball.faces, source="aside")
    capture = photograph(ball, tmp_path / "a", 2)
    photograph(aside, tmp_path / "b", 2)
    (tmp_path / "a" / image_name(1)).write_bytes((tmp_path / "b" / image_name(1)).read_bytes())
    with pytest.raises(MethodError, match="no common volume"):
        hull.reconstruct(capture, context)


def mesh_focal() -> float:
    return float(RingRig().cameras(270, 480)[0].K[0, 0])


def test_block_pruning_changes_nothing(tmp_path, context):
    capture = photograph(icosphere(0.2, centre=(0.1, 0.2, -0.05)), tmp_path)
    coarse = {"hull.voxel_m": "0.02"}
    pruned = hull8.configured(coarse).reconstruct(capture, context).mesh
    whole = hull8.configured({**coarse, "hull.block": "64"}).reconstruct(capture, context).mesh
    assert pruned.signed_volume == pytest.approx(whole.signed_volume, rel=0.01)


def test_a_subject_cut_by_the_frame_is_not_carved_beyond_it(tmp_path, context):
    tall = icosphere(1.0)
    stretched = Mesh(tall.vertices * (0.2, 1.12, 0.2), tall.faces)  # the frame is 2.16 m high
    mesh = (
        hull8.configured({"hull.voxel_m": "0.02"})
        .reconstruct(photograph(stretched, tmp_path), context)
        .mesh
    )
    assert mesh.extent[1] > 2.1


def test_no_subject_is_an_error(tmp_path, context):
    capture = photograph(icosphere(RADIUS), tmp_path)
    empty = np.zeros((480, 270, 4), np.uint8)
    save_png(tmp_path / image_name(3), empty)
    with pytest.raises(MethodError, match="no subject"):
        hull8.reconstruct(capture, context)


def test_settings_are_checked():
    assert HullSettings().voxel_m == hull8.info.parameters["hull"]["voxel_m"]
    assert hull8.configured({"hull.voxel_m": "0.01"}).info.parameters["hull"]["voxel_m"] == 0.01
    with pytest.raises(HarnessError, match="Did you mean 'hull.voxel_m'"):
        hull8.configured({"hull.voxel": "0.01"})
    for wrong in ("voxel_m=0", "voxel_m=-1", "block=-3", "margin_m=-0.1"):
        name, value = wrong.split("=")
        with pytest.raises(HarnessError, match=f"setting '{name}' cannot be '{float(value):g}"):
            hull8.configured({f"hull.{name}": value})
    with pytest.raises(HarnessError, match="cannot be 'big'"):
        hull8.configured({"hull.voxel_m": "big"})
