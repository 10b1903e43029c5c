"""The paper's rig, in closed form and against the published file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.camera_frames import read_published_cameras
from harness.core.rigs import (
    RingRig,
    Unevenness,
    camera_yaw_deg,
    focal_length_px,
    views_from_front,
)
from harness.core.settings import RenderRecipe


def test_ring8_has_the_papers_numbers() -> None:
    cameras = RingRig().cameras(1080, 1920)

    assert len(cameras) == 8
    for camera in cameras:
        assert camera.K[0, 0] == camera.K[1, 1] == pytest.approx(2666.6666667)
        assert camera.K[:2, 2].tolist() == [540, 960]
        assert np.linalg.norm(camera.position) == pytest.approx(3.0)
        assert camera.position[1] == pytest.approx(0, abs=1e-12)
        np.testing.assert_allclose(camera.project(np.zeros((1, 3)))[0], [[540, 960]])


@pytest.mark.parametrize(
    ("view", "position"), [(0, (0, 0, 3)), (2, (3, 0, 0)), (4, (0, 0, -3)), (6, (-3, 0, 0))]
)
def test_ring8_views_stand_where_their_number_says(view: int, position: tuple) -> None:
    camera = RingRig().cameras(1080, 1920)[view]

    np.testing.assert_allclose(camera.position, position, atol=1e-12)
    np.testing.assert_allclose(camera.forward, -np.array(position) / 3, atol=1e-12)


def test_the_front_view_sees_the_subjects_left_on_the_right() -> None:
    pixels, _ = RingRig().cameras(1080, 1920)[0].project([[0.5, 0, 0], [0, 0.5, 0]])

    assert pixels[0, 0] > 540
    assert pixels[1, 1] < 960


def test_the_frame_at_the_subject_is_as_wide_and_high_as_the_design_says() -> None:
    left_top, right_bottom = (
        RingRig().cameras(1080, 1920)[0].unproject([[0, 0], [1080, 1920]], [3.0, 3.0])
    )

    np.testing.assert_allclose(right_bottom - left_top, [1.215, -2.16, 0], atol=1e-12)


def test_the_published_rig_starts_at_a_yaw_of_90_degrees_in_landscape_frames(
    published_camera_file: Path,
) -> None:
    published = read_published_cameras(published_camera_file)
    ours = RingRig(first_yaw_deg=90.0).cameras(1920, 1080)

    assert len(published) == len(ours)
    for theirs, camera in zip(published, ours, strict=True):
        assert theirs.size == camera.size
        np.testing.assert_allclose(theirs.K, camera.K, atol=1e-6)
        np.testing.assert_allclose(theirs.world_to_camera, camera.world_to_camera, atol=1e-6)


def test_views_are_counted_from_the_front_however_the_rig_numbers_them() -> None:
    assert views_from_front(RingRig().cameras(90, 160)) == tuple(range(8))
    published = RingRig(first_yaw_deg=90.0).cameras(160, 90)
    assert views_from_front(published) == (6, 7, 0, 1, 2, 3, 4, 5)
    assert [camera_yaw_deg(published[view]) for view in (6, 7, 0, 2)] == [0, 45, 90, 180]
    # Nobody stands exactly in front: the nearest counts, and pitch does not matter.
    assert views_from_front(RingRig(4, pitch_deg=30, first_yaw_deg=-100.0).cameras(9, 9)) == (
        1, 2, 3, 0,
    )  # fmt: skip
    assert views_from_front(()) == ()
    # A subject that faces +X has its left on -Z; one that faces 100 degrees is nearest to that.
    for yaw_deg in (90, 100):
        assert views_from_front(RingRig(4).cameras(9, 9), yaw_deg) == (1, 2, 3, 0)


def test_a_lifted_ring_keeps_its_radius_and_looks_at_the_centre() -> None:
    for camera in RingRig(views=5, radius_m=2.0, pitch_deg=30).cameras(100, 100):
        assert camera.position[1] == pytest.approx(1.0)
        assert np.linalg.norm(camera.position) == pytest.approx(2.0)
        np.testing.assert_allclose(camera.forward, -camera.position / 2, atol=1e-12)


def test_the_sensor_is_fitted_to_the_longer_side() -> None:
    assert focal_length_px(50, 36, 1080, 1920) == focal_length_px(50, 36, 1920, 1080)
    assert focal_length_px(50, 36, 36, 36) == 50


def test_a_walked_ring_keeps_its_bounds_and_says_nothing_where_there_is_none() -> None:
    rig = RingRig(radius_m=4.0, uneven=Unevenness(seed=3))
    cameras = rig.cameras(108, 192)
    assert [c.to_dict() for c in rig.cameras(108, 192)] == [c.to_dict() for c in cameras]
    yaws = np.array([camera_yaw_deg(camera) for camera in cameras])
    steps = np.diff(np.sort(yaws), append=np.sort(yaws)[0] + 360)
    assert steps.sum() == pytest.approx(360)
    assert 20 < steps.min() < 40 < 50 < steps.max() < 90
    assert (np.diff(yaws) < 0).sum() > 1  # shuffled
    places = np.array([camera.position for camera in cameras])
    distances = np.linalg.norm(places, axis=1)
    assert 3.0 <= distances.min() < distances.max() <= 5.0
    assert np.degrees(np.abs(np.arcsin(places[:, 1] / distances))).max() <= 15.0
    for camera in cameras:
        beside = camera.project([[0.0, 0, 0]])[0][0] - [54, 96]
        assert np.abs(beside).max() < 0.1 / 3 * camera.K[0, 0]
        right_of_level = np.degrees(np.arcsin(camera.rotation[0, 1]))
        assert abs(right_of_level) < 3.5
    plain = RenderRecipe("r", RingRig(), 108, 192).to_dict()
    assert "uneven" not in plain["rig"]
    assert RenderRecipe("r", rig, 108, 192).to_dict()["rig"]["uneven"]["seed"] == 3
