"""Dents of a start surface: filled where photos show something in front, kept where they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.core.errors import HarnessError
from harness.core.mesh import Mesh
from methods.closed.lattices import remeshed
from methods.photo_pull.dents import Undented, without_dents
from methods.photo_pull.pulled import StereoTask
from methods.stereo.pull import joined, pull
from methods.stereo.settings import DentSettings, near_settings
from methods.stereo.surface import stereo_points
from tests.spheres import icosphere
from tests.unit.methods.stereo.conftest import CAMERAS, RADIUS, grain, photographs, plain

FRONT = tuple(CAMERAS[view] for view in (6, 7, 0, 1, 2))
NO_HANDS = np.zeros((0, 3))


def pleated() -> Mesh:
    """The sphere with a pleat of 9 cm depth and 2 cm width in front, from top to bottom."""
    sphere = icosphere(RADIUS, 6)
    out = sphere.vertices / np.linalg.norm(sphere.vertices, axis=1, keepdims=True)
    across, along = out[:, 0], np.arcsin(np.clip(out[:, 1], -1, 1))
    share = np.exp(-((across / 0.06) ** 4) - (along / 0.5) ** 4) * (out[:, 2] > 0)
    return remeshed(Mesh(sphere.vertices - 0.09 * share[:, None] * out, sphere.faces), 0.004)


@pytest.fixture(scope="module")
def dented() -> Mesh:
    return pleated()


def asked(start: Mesh, views, hands=NO_HANDS) -> Undented:
    task = StereoTask(range(len(FRONT)), hands, near_settings())
    return without_dents(start, views, task, DentSettings())


def off_mm(mesh: Mesh) -> float:
    """Mean distance from the sphere of the front's vertices."""
    front = mesh.vertices[mesh.vertices[:, 2] > 0.5 * RADIUS]
    return 1e3 * float(np.abs(np.linalg.norm(front, axis=1) - RADIUS).mean())


@pytest.mark.nightly
def test_a_narrow_pleat_that_the_subject_has_not_is_filled_and_comes_out(sphere, dented):
    views, settings = photographs(sphere, FRONT, grain), near_settings()
    found = asked(dented, views)
    assert len(found.filled_m3) == 1 < len(found.points)
    assert off_mm(found.start) < 0.5 * off_mm(dented)
    points = stereo_points(views, dented, settings)
    before = pull(dented, points, settings.pulls, remeshed).mesh
    after = pull(found.start, joined((points, found.points)), settings.pulls, remeshed).mesh
    assert off_mm(after) < 0.5
    assert off_mm(before) > 3 * off_mm(after)


def test_a_pleat_that_the_subject_has_stays(dented):
    found = asked(dented, photographs(dented, FRONT, grain))
    assert found.hollows >= 1
    assert len(found.filled_m3) == len(found.points) == 0
    assert found.start is dented


def test_photos_of_plain_cloth_fill_nothing(sphere, dented):
    assert len(asked(dented, photographs(sphere, FRONT, plain)).filled_m3) == 0


def test_a_pleat_beside_a_hand_stays(sphere, dented):
    hand = np.array([[0.0, 0.0, RADIUS - 0.03]])
    assert len(asked(dented, photographs(sphere, FRONT, grain), hand).filled_m3) == 0


def test_a_surface_without_hollows_asks_nothing(sphere):
    found = asked(sphere, [])
    assert found.hollows == 0
    assert found.start is sphere


def test_a_ball_smaller_than_a_step_of_the_lattice_is_refused():
    with pytest.raises(HarnessError, match="radius_m"):
        replace(DentSettings(), radius_m=0.001)
    assert replace(DentSettings(), radius_m=0.0).radius_m == 0
