"""Landmarks that views contradict each other about are where most of them put them."""

from __future__ import annotations

import numpy as np

from harness.core.rigs import RingRig
from harness.geometry.place import Place
from methods.body.photos.agreement import agreed, placed
from methods.body.photos.detection import COUNT, Detections
from methods.body.photos.views import View, Views

CAMERAS = RingRig(views=8).cameras(540, 960)
#: A person's landmarks about the origin, metres.
POINTS = np.random.default_rng(3).normal(0.0, [0.25, 0.5, 0.15], (COUNT, 3))
LEFT_ARM, RIGHT_ARM = [13, 15, 17, 19, 21], [14, 16, 18, 20, 22]


def in_space(cameras=CAMERAS):
    about = POINTS - POINTS[[23, 24]].mean(axis=0)
    return np.array([about @ camera.rotation.T for camera in cameras])


def found(cameras=CAMERAS, depth_off_m=0.1):
    """Exact pixels, and landmarks in space whose depth each view has wrong."""
    rng = np.random.default_rng(0)
    guessed = in_space(cameras)
    guessed[..., 2] += rng.normal(0.0, depth_off_m, guessed.shape[:2])
    return Detections(
        pixels=np.array([camera.project(POINTS)[0] for camera in cameras]),
        points_camera=guessed,
        confidence=np.full((len(cameras), COUNT), 0.8),
        hands=np.ones((len(cameras), 2)),
    )


def views(detections, cameras=CAMERAS):
    place = Place(np.zeros(3), 0.9, 0.4, depth_is_known=True)
    seen = [
        View(index, camera, np.ones((1, 1)), 900.0, place) for index, camera in enumerate(cameras)
    ]
    return Views(tuple(seen), detections, {})


def test_exact_pixels_give_the_points():
    told = found()
    points, misses, is_agreed = placed(CAMERAS, told.pixels, told.confidence)
    np.testing.assert_allclose(points, POINTS, atol=1e-9)
    assert misses.max() < 1e-9
    assert is_agreed.all()


def test_views_that_are_wrong_do_little_and_one_without_confidence_nothing():
    told = found()
    told.pixels[3] += 300.0
    told.pixels[5] -= 200.0
    points, misses, is_agreed = placed(CAMERAS, told.pixels, told.confidence)
    assert np.linalg.norm(points - POINTS, axis=1).max() < 0.01
    assert (misses[[3, 5]] > 0.05).all()
    assert is_agreed.all()
    told.confidence[[3, 5]] = 0.0
    points, _, _ = placed(CAMERAS, told.pixels, told.confidence)
    np.testing.assert_allclose(points, POINTS, atol=1e-9)


def test_the_nearer_a_ray_must_be_the_less_a_wrong_view_does():
    told = found()
    told.pixels[3] += 300.0
    points, _, _ = placed(CAMERAS, told.pixels, told.confidence, 0.02)
    assert np.linalg.norm(points - POINTS, axis=1).max() < 2e-3


def test_depth_that_each_view_has_wrong_is_that_of_all():
    np.testing.assert_allclose(agreed(views(found())).points_camera, in_space(), atol=1e-8)


def test_an_arm_that_two_views_exchange_is_put_right_and_the_rest_stays():
    """The exchanged pixels are shown where the others put them, as sure as they are."""
    right, told = found(), found()
    for view in (2, 6):
        told.pixels[view, LEFT_ARM] = right.pixels[view, RIGHT_ARM]
        told.pixels[view, RIGHT_ARM] = right.pixels[view, LEFT_ARM]
        told.confidence[view, LEFT_ARM + RIGHT_ARM] = 0.1
    result = agreed(views(told))
    apart = np.linalg.norm(right.pixels - told.pixels, axis=2) > 30.0
    assert apart.sum() >= 10
    np.testing.assert_allclose(result.pixels[apart], right.pixels[apart], atol=3.0)
    np.testing.assert_allclose(result.confidence[apart], 0.8)
    others = [index for index in range(COUNT) if index not in LEFT_ARM + RIGHT_ARM]
    np.testing.assert_array_equal(result.pixels[:, others], told.pixels[:, others])


def test_two_views_a_row_of_views_and_contradictions_change_nothing():
    """Two views outvote no third, and views from one side or its opposite tell no depth."""
    opposite = [CAMERAS[0], CAMERAS[4]]
    for cameras in (opposite, list(CAMERAS[:2]), [*opposite, CAMERAS[0]]):
        told = found(cameras)
        result = agreed(views(told, cameras))
        np.testing.assert_array_equal(result.points_camera, told.points_camera)
        np.testing.assert_array_equal(result.pixels, told.pixels)
    told = found()
    rng = np.random.default_rng(1)
    told.pixels[:, 15] = rng.uniform(0, 900, (8, 2))
    result = agreed(views(told))
    np.testing.assert_array_equal(result.pixels[:, 15], told.pixels[:, 15])
    np.testing.assert_array_equal(result.points_camera[:, 15], told.points_camera[:, 15])


def test_mirrored_views_agree_on_the_mirrored_landmarks():
    every = np.ones(8, dtype=bool)
    told = found()
    told.pixels[2] += 80.0
    ways = [agreed(views(told.mirrored(every))), agreed(views(told)).mirrored(every)]
    for field in ("pixels", "points_camera", "confidence"):
        one, other = (getattr(way, field) for way in ways)
        np.testing.assert_allclose(one, other, atol=1e-9)
