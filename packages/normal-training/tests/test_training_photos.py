"""Cameras, light, gloss and prints of training photos."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from harness.geometry.window import Window
from normal_training.learning.variations.light import (
    Gloss,
    Lamp,
    Light,
    drawn_gloss,
    drawn_light,
    photographed,
    sky_and_ground,
)
from normal_training.sampling.fabric_prints import printed
from normal_training.sampling.viewpoint import PhotoSize, drawn_camera

BOX = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.85, 0.85) for z in (-0.2, 0.2)])
EVEN = Light(np.full(3, 0.5), np.full(3, 0.5), (), exposure=1.0, contrast=1.0, noise=0.0)


def test_cameras_look_at_the_subject_as_methods_crop_it():
    draw = np.random.default_rng(0)
    behind = 0
    for _ in range(60):
        camera = drawn_camera(BOX, PhotoSize(512, 320, 480), draw)
        assert camera.size == (320, 480)
        seen = Window.around_points(BOX, camera.cropped(-300, -300, 920, 1080), margin=0)
        assert 0.80 * 512 < seen.height < 0.97 * 512
        centre = (seen.left - 300 + seen.width / 2, seen.top - 300 + seen.height / 2)
        np.testing.assert_allclose(centre, (160, 240), atol=16)
        assert camera.K[0, 0] == pytest.approx(camera.K[1, 1], rel=0.01)
        behind += camera.position[2] < 0
    assert 15 < behind < 45


def test_light_adds_up_and_noise_is_of_its_size():
    draw = np.random.default_rng(0)
    np.testing.assert_allclose(photographed(np.full((4, 3), 0.214), EVEN, draw), 0.5, atol=1e-3)
    noisy = replace(EVEN, noise=0.02)
    assert photographed(np.full((9999, 3), 0.2), noisy, draw).std() == pytest.approx(0.02, rel=0.05)


def test_lamps_stand_on_the_camera_s_side():
    K = np.array([[500, 0, 250], [0, 500, 250], [0, 0, 1.0]])
    camera = Camera(K, look_at((2.0, 0.3, -2.0), np.zeros(3)), 500, 500)
    draw = np.random.default_rng(0)
    lamps: list[Lamp] = [lamp for _ in range(40) for lamp in drawn_light(camera, draw).lamps]
    centres = np.array([lamp.points.mean(axis=0) for lamp in lamps])
    assert ((centres @ camera.forward) < 0.5).all()
    assert (centres[:, 1] > 0).mean() > 0.7


def test_some_cameras_look_down_or_up_and_some_stand_near():
    draw = np.random.default_rng(0)
    cameras = [drawn_camera(BOX, PhotoSize(512, 320, 480), draw) for _ in range(200)]
    distances = np.array([np.linalg.norm(camera.position) for camera in cameras])
    pitches = np.degrees(np.arcsin([c.position[1] for c in cameras] / distances))
    assert 1.6 <= distances.min() < 1.8
    assert 4.6 < distances.max() <= 5.0
    assert pitches.min() < -12
    assert pitches.max() > 24
    assert (abs(pitches) < 10).mean() > 0.55
    # The subject is as large in every picture, however near the camera is.
    wide = [camera.cropped(-300, -300, 920, 1080) for camera in cameras]
    sizes = [Window.around_points(BOX, camera, margin=0).height for camera in wide]
    assert min(sizes) > 0.80 * 512
    assert max(sizes) < 0.97 * 512


def test_light_from_above_and_below_is_shared_by_the_normal():
    light = replace(EVEN, sky=np.full(3, 0.8), ground=np.full(3, 0.2))
    normals = np.array([[0, 1.0, 0], [0, -1.0, 0], [1.0, 0, 0]])
    arriving = sky_and_ground(normals) @ light.colours
    np.testing.assert_allclose(arriving[:, 0], [0.8, 0.2, 0.5])


def test_gloss_shines_where_the_mirror_would_and_fades_beside_it():
    gloss = Gloss(0.2, 20.0)
    up, camera = np.array([[0, 0, 1.0]]), np.array([[0.6, 0, 0.8]])
    there = gloss.share(up, np.array([[-0.6, 0, 0.8]]), camera)
    assert there[0] == pytest.approx(0.2 * 28 / 8)
    beside = gloss.share(up, np.array([[0.6, 0, 0.8]]), camera)
    assert beside[0] == pytest.approx(0.2 * 28 / 8 * 0.8**20)
    assert Gloss(0.0, 1.0).share(up, camera, camera)[0] == 0.0
    draw = np.random.default_rng(0)
    kinds = [drawn_gloss(draw).strength for _ in range(200)]
    assert 0.5 < np.mean(np.array(kinds) == 0) < 0.7
    assert max(kinds) < 0.2


def test_prints_change_some_of_a_texture_alike_for_equal_seeds():
    plain = np.full((256, 256, 3), 120, np.uint8)
    found = printed(plain, np.random.default_rng(3))
    changed = (found != plain).any(axis=2).mean()
    assert found.shape == plain.shape
    assert found.dtype == np.uint8
    assert 0.02 < changed < 0.95
    np.testing.assert_array_equal(found, printed(plain, np.random.default_rng(3)))
    assert (found != printed(plain, np.random.default_rng(4))).any()
    assert (plain == 120).all()


def test_prints_are_as_large_on_a_finer_texture():
    coarse, fine = (
        (printed(np.full((n, n, 3), 120, np.uint8), np.random.default_rng(5)) != 120).any(axis=2)
        for n in (128, 512)
    )
    assert coarse.mean() == pytest.approx(fine.mean(), rel=0.2)
