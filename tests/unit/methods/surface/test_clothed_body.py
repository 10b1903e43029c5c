"""The body moved out to silhouettes: ways out of known hulls, and which are obstructed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.outline import Outline
from harness.geometry.raycast import Raycaster
from methods.surface.completion import clothed_body, is_unobstructed, ways_out_m

BODY_M, CLOTHES_M = 0.20, 0.25
#: A step of the walk, half of it, and a pixel of the small pictures.
STEP_M, PIXEL_M = 0.004, 0.006


@pytest.fixture
def sphere(ball: Mesh) -> Callable[..., Mesh]:
    """``sphere(radius, centre)``: closed, outward, with a ring of vertices on its equator."""
    return lambda radius, centre=(0.0, 0.0, 0.0): Mesh(ball.vertices * radius + centre, ball.faces)


def outlines(mesh: Mesh, views: int = 8) -> list[Outline]:
    caster = Raycaster(mesh)
    return [
        Outline(camera, caster.mask(camera).astype(float))
        for camera in RingRig(views=views).cameras(270, 480)
    ]


def equator(mesh: Mesh) -> np.ndarray:
    return np.abs(mesh.vertices[:, 1]) < 0.01


def test_the_way_out_is_as_long_as_the_clothes_are_thick_where_an_outline_touches(sphere):
    """Eight perspective views touch a ball at yaw ± arccos(r / d): sixteen tangents."""
    body, views = sphere(BODY_M), outlines(sphere(CLOTHES_M))
    directions = body.vertices / BODY_M
    ways = ways_out_m(body.vertices, directions, views)[equator(body)]
    touch_deg = np.degrees(np.arccos(CLOTHES_M / 3.0))
    gap = np.radians(max((2 * touch_deg) % 45, 45 - (2 * touch_deg) % 45))
    corner_m = CLOTHES_M / np.cos(gap / 2) - CLOTHES_M
    away = STEP_M / 2 + PIXEL_M
    assert ways.min() == pytest.approx(CLOTHES_M - BODY_M, abs=away)
    assert ways.max() == pytest.approx(CLOTHES_M - BODY_M + corner_m, abs=away)


def test_a_body_that_stands_out_is_brought_in_and_one_without_an_end_in_reach_has_no_way(sphere):
    body = sphere(BODY_M)
    directions = body.vertices / BODY_M
    smaller = ways_out_m(body.vertices, directions, outlines(sphere(0.185)))
    side = equator(body)
    assert smaller[side].max() < 0.0
    assert np.median(smaller[side]) == pytest.approx(-0.015, abs=PIXEL_M)
    assert np.isnan(ways_out_m(body.vertices, directions, outlines(sphere(0.6)))).all()
    # Beyond a picture's frame nothing denies that there is more of the subject.
    afar = body.vertices + np.array([9.0, 0.0, 0.0])
    assert np.isnan(ways_out_m(afar, directions, outlines(body, 1))).all()


def test_the_clothed_body_is_nearer_to_the_clothes_on_all_sides(sphere):
    body, clothes = sphere(BODY_M), sphere(CLOTHES_M)
    moved = clothed_body(body, outlines(clothes))
    radius = np.linalg.norm(moved.vertices, axis=1)
    # Four fifths of the way, and the hull is a little larger than the ball.
    assert radius[equator(moved)].mean() == pytest.approx(BODY_M + 0.8 * 0.055, abs=0.006)
    assert radius.min() > BODY_M + 0.03
    assert moved.faces is body.faces


def test_a_way_that_another_limb_is_in_is_obstructed(sphere):
    """Two balls 4 cm apart: straight across, only a way of less than a centimetre is clear."""
    left, right = sphere(0.1, (-0.12, 0.0, 0.0)), sphere(0.1, (0.12, 0.0, 0.0))
    count = len(left.vertices)
    body = Mesh(
        np.concatenate([left.vertices, right.vertices]),
        np.concatenate([left.faces, right.faces + count]),
    )
    centres = np.repeat([[-0.12, 0.0, 0.0], [0.12, 0.0, 0.0]], count, axis=0)
    normals = (body.vertices - centres) / 0.1
    inner, outer = left.vertices[:, 0].argmax(), left.vertices[:, 0].argmin()
    for way_m, across, away in ((0.008, True, True), (0.012, False, True), (np.nan, False, False)):
        found = is_unobstructed(body, normals, np.full(2 * count, way_m))
        assert (found[inner], found[outer]) == (across, away)
