"""The scan's own depth through alignment, filters and meshing: what they lose by themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.core.errors import HarnessError, MethodError
from harness.core.protocols import Privilege
from harness.geometry.coinciding import open_edges
from harness.geometry.surface import SurfaceIndex
from methods.from_points.oracle8 import RenderedDepth, oracle8_points
from methods.points.surfacing import reconstructed
from metrics.cameras import camera_errors

FAST = {"mesh.depth": "6", "mesh.cell_m": "0.01", "depth.longest_px": "240"}


def errors_m(mesh, truth):
    """Distances of the mesh's vertices to the truth, and of the truth's to the mesh.

    Without the poles, which no view sees, and which the surface cuts off by 3 cm.
    """

    def seen(points):
        return points[np.abs(points[:, 1] - truth.bounds.mean(axis=0)[1]) < 0.4]

    there = SurfaceIndex(truth).closest(seen(mesh.vertices))[1]
    return there, SurfaceIndex(mesh).closest(seen(truth.vertices))[1]


@pytest.mark.parametrize("mode", ["sim3_cameras", "known_cameras", "native_posed", "oracle_icp"])
def test_a_sphere_comes_back_whatever_world_its_depth_was_in(mode, capture, context, ball):
    method = oracle8_points.configured({**FAST, "align.mode": mode})
    result = reconstructed(method, capture, context)
    there, back = errors_m(result.mesh, ball)
    assert there.mean() < 0.001
    assert back.mean() < 0.001
    assert open_edges(result.mesh) == 0
    assert mode in method.info.title
    found = result.details["alignment"]
    assert found["mode"] == mode
    if mode != "native_posed":
        assert found["centre_rms_mm"] < 1e-3
        assert abs(np.log(found["scale"])) > 1e-3
        for camera, known in result.cameras:
            given = capture.cameras[0]
            np.testing.assert_allclose(known.K, given.K, rtol=0.01)
            np.testing.assert_allclose(camera.K, known.K)
        errors = camera_errors(*zip(*result.cameras, strict=True), ball.vertices)
        assert errors["camera_rotation"].value < 1e-4
        assert errors["camera_reprojection"].value < 1e-3
    else:
        assert result.cameras == ()


def test_two_opposite_views_are_aligned_too(capture, context, ball):
    pair = RenderedDepth((0, 4)).configured(FAST)
    result = reconstructed(pair, capture, context)
    assert result.details["alignment"]["centre_rms_mm"] < 1e-3
    there, _ = errors_m(result.mesh, ball)
    assert np.median(there) < 0.005


@pytest.mark.parametrize("smooth", [0.0, 6.0])
def test_one_percent_of_noise_costs_less_than_itself(smooth, capture, context, ball):
    """3 cm at 3 m; what is left after eight views and the surface's own smoothness."""
    settings = {**FAST, "depth.noise": "0.01", "depth.noise_px": str(smooth)}
    noisy = oracle8_points.configured({**settings, "keep.edge": "0.1", "keep.consistency_m": "0.1"})
    assert "1.0% noise" in noisy.info.title
    result = reconstructed(noisy, capture, context)
    there, back = errors_m(result.mesh, ball)
    assert 0.001 < there.mean() < 0.02
    assert back.mean() < 0.02


@pytest.mark.nightly
def test_equal_seeds_give_equal_meshes_and_others_other_noise(capture, context):
    noisy = oracle8_points.configured({**FAST, "depth.noise": "0.002"})
    first, second = (reconstructed(noisy, capture, context).mesh for _ in range(2))
    np.testing.assert_array_equal(first.vertices, second.vertices)
    other = reconstructed(noisy, capture, replace(context, seed=8)).mesh
    assert first.vertices.shape != other.vertices.shape or (first.vertices != other.vertices).any()


def test_the_scan_is_a_privilege_and_icp_too():
    assert Privilege.GROUND_TRUTH_MESH in oracle8_points.info.privileges
    assert Privilege.KNOWN_CAMERAS in oracle8_points.info.privileges


def test_without_the_scan_it_says_so(capture, context):
    with pytest.raises(MethodError, match="not lent"):
        reconstructed(oracle8_points, capture, replace(context, privileged={}))


def test_settings_that_cannot_be_are_refused():
    for text in ({"align.mode": "icp"}, {"depth.noise": "2"}, {"mesh.trim": "1"}):
        with pytest.raises(HarnessError, match="cannot be"):
            oracle8_points.configured(text)
    noisy = oracle8_points.configured({"depth.noise": "0.01"})
    assert noisy.info.title == "Depth of the scan with 1.0% noise, 8 views, sim3_cameras"
