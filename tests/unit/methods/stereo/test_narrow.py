"""The narrow search on a textured sphere."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.mesh import Mesh
from methods.stereo.settings import MatchSettings, StereoSettings
from methods.stereo.surface import finished
from tests.unit.methods.stereo.conftest import CAMERAS, RADIUS, grain, photographs, plain

#: Depth maps at half the resolution of these photos, as for ``paper8``.
SETTINGS = StereoSettings(match=MatchSettings(pixel_m=0.0045))


def scaled(mesh: Mesh, by_m: float) -> Mesh:
    return Mesh(mesh.vertices * (RADIUS + by_m) / RADIUS, mesh.faces)


def off_mm(mesh: Mesh) -> np.ndarray:
    """Of what two neighbouring views of the horizontal ring see well."""
    band = np.abs(mesh.vertices[:, 1]) < 0.6 * RADIUS
    return 1e3 * np.abs(np.linalg.norm(mesh.vertices[band], axis=1) - RADIUS)


@pytest.mark.nightly
@pytest.mark.parametrize("by_m", [0.003, -0.003])
def test_a_few_millimetres_are_taken_back(sphere, textured, by_m):
    found = finished(scaled(sphere, by_m), textured, SETTINGS)
    report, mesh = found.rounds[0], found.mesh
    assert np.quantile(off_mm(mesh), 0.95) < 0.8
    assert report.vertices > 0.5
    assert report.believed > 0.9


@pytest.mark.nightly
def test_a_plain_sphere_stays(sphere):
    start = scaled(sphere, 0.003)
    found = finished(start, photographs(sphere, CAMERAS, plain, 2.0), SETTINGS)
    report, mesh = found.rounds[0], found.mesh
    np.testing.assert_allclose(mesh.vertices, start.vertices, atol=1e-4)
    assert report.vertices < 0.01


@pytest.mark.nightly
def test_without_neighbours_nothing_moves(sphere):
    views = photographs(sphere, (CAMERAS[0], CAMERAS[4]), grain)
    found = finished(sphere, views, SETTINGS)
    report, mesh = found.rounds[0], found.mesh
    np.testing.assert_array_equal(mesh.vertices, sphere.vertices)
    assert report.moved_m == 0.0


def test_photos_as_coarse_as_those_of_the_depth_maps_tell_nothing_new(sphere, textured):
    found = finished(sphere, textured, StereoSettings())
    assert found.rounds == ()
    assert found.mesh is sphere
