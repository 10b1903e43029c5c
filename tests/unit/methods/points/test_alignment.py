"""Known similarities of cameras: recovered, also for two views; mirrored ones refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.rigs import RingRig
from harness.geometry.similarity import Similarity, camera_similarity, point_similarity

CAMERAS = RingRig(pitch_deg=0.0).cameras(108, 192)


def somewhere(seed: int) -> Similarity:
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    return Similarity(float(rng.uniform(0.1, 8.0)), turn, rng.uniform(-3, 3, 3))


def inverse(of: Similarity) -> Similarity:
    turn = of.rotation.T
    return Similarity(1 / of.scale, turn, -turn @ of.shift / of.scale)


@pytest.mark.parametrize("views", [range(8), (0, 4), (0, 1), (0, 3), (0, 1, 2)], ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_a_known_similarity_is_recovered(views, seed):
    """Opposite cameras stand and look along one line: their up axes say the rest."""
    known = [CAMERAS[view] for view in views]
    own = somewhere(seed)
    fit = camera_similarity([own.camera(camera) for camera in known], known)
    back = inverse(own)
    assert fit.similarity.scale == pytest.approx(back.scale, rel=1e-6)
    np.testing.assert_allclose(fit.similarity.rotation, back.rotation, atol=1e-6)
    np.testing.assert_allclose(fit.similarity.shift, back.shift, atol=1e-6)
    assert fit.centre_rms_m < 1e-6
    assert fit.angle_rms_deg < 1e-4


def test_centres_alone_would_not_do_for_two_views():
    """The fit depends on the cameras' axes: turned about the line of two centres, it follows."""
    pair = [CAMERAS[0], CAMERAS[4]]
    line = pair[0].position - pair[1].position
    about = _turn_about(line / np.linalg.norm(line), 0.7)
    turned = [camera.in_frame(about) for camera in pair]
    fit = camera_similarity(turned, pair)
    np.testing.assert_allclose(fit.similarity.rotation, about[:3, :3].T, atol=1e-9)
    assert not np.allclose(fit.similarity.rotation, np.eye(3), atol=0.1)


def _turn_about(axis, angle):
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    move = np.eye(4)
    move[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return move


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("flipped", [0, 1, 2])
def test_a_mirrored_world_is_refused(axis, flipped):
    """Whichever camera axis a wrong convention turned round to stay right-handed.

    The cameras stand at two heights: all on one level, seen upside down, are no mirror image.
    """
    cameras = [*CAMERAS[::2], *RingRig(pitch_deg=30.0).cameras(108, 192)[1::2]]
    mirror = np.diag([-1.0 if each == axis else 1.0 for each in range(3)])
    fix = np.diag([-1.0 if each == flipped else 1.0 for each in range(3)])
    mirrored = []
    for camera in cameras:
        move = np.eye(4)
        move[:3, :3] = fix @ camera.rotation @ mirror
        move[:3, 3] = -move[:3, :3] @ (mirror @ camera.position)
        mirrored.append(Camera(camera.K, move, camera.width, camera.height))
    with pytest.raises(MethodError, match="mirror image|do not stand"):
        camera_similarity(mirrored, cameras)


def test_a_level_ring_in_a_mirror_is_refused():
    """Left and right exchanged, with the cameras' x axes turned round."""
    mirror = np.diag([-1.0, 1.0, 1.0])
    found = []
    for camera in CAMERAS:
        move = np.eye(4)
        move[:3, :3] = mirror @ camera.rotation @ mirror
        move[:3, 3] = -move[:3, :3] @ (mirror @ camera.position)
        found.append(Camera(camera.K, move, camera.width, camera.height))
    with pytest.raises(MethodError, match="mirror image"):
        camera_similarity(found, CAMERAS)


def test_mirrored_points_are_never_mirrored_back():
    points = np.random.default_rng(1).standard_normal((50, 3))
    found = point_similarity(points, points * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    own = somewhere(5)
    same = point_similarity(points, own.points(points))
    assert same.scale == pytest.approx(own.scale)
    np.testing.assert_allclose(same.rotation, own.rotation, atol=1e-9)


def test_small_errors_of_the_cameras_stay_small():
    rng = np.random.default_rng(3)
    own = somewhere(3)
    found = []
    for camera in CAMERAS:
        moved = own.camera(camera)
        axis = rng.standard_normal(3)
        nudge = _turn_about(axis / np.linalg.norm(axis), np.radians(1.0))
        found.append(moved.turned(nudge[:3, :3]))
    fit = camera_similarity(found, CAMERAS)
    assert fit.angle_rms_deg == pytest.approx(1.0, abs=0.15)
    assert fit.similarity.scale == pytest.approx(1 / own.scale, rel=1e-3)


def test_what_cannot_be_aligned_is_refused():
    with pytest.raises(MethodError, match="two views or more"):
        camera_similarity(CAMERAS[:1], CAMERAS[:1])
    here = [replace(camera, world_to_camera=CAMERAS[0].world_to_camera) for camera in CAMERAS]
    with pytest.raises(MethodError, match="at one place"):
        camera_similarity(here, CAMERAS)
    order = [CAMERAS[view] for view in (3, 0, 5, 1, 7, 2, 4, 6)]
    with pytest.raises(MethodError, match="do not stand"):
        camera_similarity(order, CAMERAS)
