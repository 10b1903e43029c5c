"""Silhouettes whose distances are known."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from harness.geometry.outline import Outline, inner_depth_px
from harness.geometry.window import Window

SIZE, FOCAL = 40, 100.0
CAMERA = Camera(
    np.array([[FOCAL, 0.0, SIZE / 2], [0.0, FOCAL, SIZE / 2], [0.0, 0.0, 1.0]]),
    look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)),
    SIZE,
    SIZE,
)


def half_plane(edge_px: float) -> Outline:
    """The subject is right of a column; the pixel that the edge crosses is covered in part."""
    columns = np.arange(SIZE)
    coverage = np.clip(columns + 1 - edge_px, 0.0, 1.0)
    return Outline(CAMERA, np.tile(coverage, (SIZE, 1)))


@pytest.mark.parametrize("edge_px", [12.0, 12.25, 12.5, 12.75])
def test_the_distance_to_a_straight_edge_is_exact_beside_it_and_near_by_beyond(edge_px):
    outline = half_plane(edge_px)
    true = np.arange(SIZE) + 0.5 - edge_px
    found = outline.distance_px[7]
    beside = np.abs(true) < 0.5
    np.testing.assert_allclose(found[beside], true[beside], atol=1e-6)
    np.testing.assert_allclose(found, true, atol=0.51)
    assert ((found > 0) == (true > 0))[np.abs(true) > 0.01].all()
    # The frame does not end the subject: its border column is as deep as its distance says.
    assert found[-1] > 26


def test_distances_are_metres_at_the_depth_of_the_point():
    outline = half_plane(12.0)
    for depth_m in (1.0, 3.0):
        points = CAMERA.unproject([(24.5, 20.5), (4.5, 20.5)], [depth_m, depth_m])
        expected = np.array([12.5, -7.5]) * depth_m / FOCAL
        np.testing.assert_allclose(outline.distance_m(points), expected, atol=1e-6)


def test_what_is_held_and_that_nothing_ends_beyond_the_frame():
    outline = half_plane(12.0)
    pixels = [(13.0, 5.0), (11.0, 5.0), (-300.0, 5.0), (13.0, 900.0)]
    points = CAMERA.unproject(pixels, [2.0] * 4)
    behind = CAMERA.position - CAMERA.forward
    held = outline.holds(np.concatenate([points, [behind]]))
    assert held.tolist() == [True, False, True, True, True]


def test_the_box_and_an_empty_view():
    outline = half_plane(12.0)
    assert outline.box == Window(12, 0, 28, 40)
    assert not outline.is_empty
    assert Outline(CAMERA, np.full((SIZE, SIZE), 0.5)).is_empty


def test_another_size_is_the_mean_of_what_it_covers():
    small = half_plane(11.0).resized(10, 20)
    assert small.camera.size == (10, 20)
    np.testing.assert_allclose(small.coverage[3, :4], [0.0, 0.0, 0.25, 1.0], atol=1e-6)
    pixels, _ = small.camera.project([[0.1, 0.2, 0.3]])
    full, _ = CAMERA.project([[0.1, 0.2, 0.3]])
    np.testing.assert_allclose(pixels, full / (4, 2))


def test_a_window_has_the_distances_of_the_whole():
    outline, window = half_plane(12.25), Window(4, 10, 20, 25)
    part = outline.cropped(window)
    np.testing.assert_array_equal(part.distance_px, outline.distance_px[10:35, 4:24])
    point = outline.camera.unproject([(15.0, 20.0)], [2.5])
    np.testing.assert_allclose(part.distance_m(point), outline.distance_m(point), rtol=1e-6)


def test_without_an_outline_all_is_deep_inside_or_far_outside():
    for coverage, sign in ((1.0, 1), (0.0, -1)):
        distance = Outline(CAMERA, np.full((SIZE, SIZE), coverage)).distance_px
        assert (distance == sign * 2 * SIZE).all()


def test_depth_counts_from_the_outline_to_pixel_centres():
    mask = np.zeros((9, 9), bool)
    mask[2:7, 2:7] = True
    assert inner_depth_px(mask)[4, 1:8].tolist() == [-0.5, 0.5, 1.5, 2.5, 1.5, 0.5, -0.5]
    mask[2:7, 7:] = True  # now the frame cuts it on the right: it goes on there
    assert inner_depth_px(mask)[4, 5:].tolist() == [2.5, 2.5, 2.5, 2.5]
