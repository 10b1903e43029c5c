"""The border by example: the published file, Blender's axes, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from harness.core.camera_frames import (
    OPENCV_TO_BLENDER_CAMERA,
    camera_to_blender,
    quaternion_from_rotation,
    read_published_cameras,
    rotation_from_quaternion,
    write_colmap,
    write_transforms_json,
)
from harness.core.errors import DataError
from harness.core.rigs import RingRig

RIG = RingRig().cameras(1080, 1920)
#: Places, order and frames of the published file.
PUBLISHED_RIG = RingRig(first_yaw_deg=90.0).cameras(1920, 1080)
#: From x left, y up, z forward to Blender's x right, y up, z backward.
HALF_TURN_ABOUT_Y = np.diag([-1.0, 1.0, -1.0, 1.0])


def published(axes: np.ndarray) -> list[dict]:
    """The published rig as its file has it, with rotations in the given camera axes."""
    poses = [camera_to_blender(camera) @ axes for camera in PUBLISHED_RIG]
    return [
        {
            "frame": index,
            "location": pose[:3, 3].tolist(),
            "quaternion": quaternion_from_rotation(pose[:3, :3]).tolist(),
            "focal_length_px": 8000 / 3,
            "image_size": [1920, 1080],
        }
        for index, pose in enumerate(poses)
    ]


def write(path: Path, value: object) -> Path:
    path.write_text(json.dumps(value))
    return path


@pytest.mark.parametrize("axes", [np.eye(4), HALF_TURN_ABOUT_Y], ids=["towards", "away"])
def test_published_rotations_may_face_the_subject_or_look_away(
    tmp_path: Path, axes: np.ndarray
) -> None:
    read = read_published_cameras(write(tmp_path / "cameras.json", published(axes)))

    for camera, expected in zip(read, PUBLISHED_RIG, strict=True):
        np.testing.assert_allclose(camera.world_to_camera, expected.world_to_camera, atol=1e-9)
        np.testing.assert_allclose(camera.K, expected.K, atol=1e-9)
        assert (camera.width, camera.height) == (1920, 1080)


def blender(x: float, y: float, z: float) -> list[float]:
    """Our world's coordinates of a point in Blender's, written out once more."""
    return [x, z, -y]


def test_an_entry_written_by_hand_is_the_camera_in_front(tmp_path: Path) -> None:
    # Camera 6 as published, rounded: at Blender's -Y, columns left, up and forward.
    left, up, forward = [-1, 0, 0], [0, 0, 1], [0, 1, 0]
    half = math.sqrt(0.5)
    np.testing.assert_allclose(
        rotation_from_quaternion([0, 0, half, half]), np.stack([left, up, forward], 1), atol=1e-12
    )
    entry = {
        "location": [0, -3, 0],
        "quaternion": [0, 0, half, half],
        "focal_length_px": 8000 / 3,
        "image_size": [1920, 1080],
    }
    (camera,) = read_published_cameras(write(tmp_path / "cameras.json", [entry]))

    np.testing.assert_allclose(camera.position, [0, 0, 3], atol=1e-12)
    assert (camera.width, camera.height) == (1920, 1080)
    # The subject's left (Blender's +X, ours too) is on the right, its head (+Z there) above.
    points = [blender(0, 0, 0), blender(0.3, 0, 0), blender(0, 0, 0.3)]
    pixels, depths = camera.project(points)
    np.testing.assert_allclose(depths, 3)
    shift = 8000 / 3 * 0.3 / 3
    np.testing.assert_allclose(pixels, [[960, 540], [960 + shift, 540], [960, 540 - shift]])


def test_the_published_cameras_look_at_the_origin_from_where_their_numbers_say(
    published_camera_file: Path,
) -> None:
    cameras = read_published_cameras(published_camera_file)

    assert len(cameras) == 8
    for number, camera in enumerate(cameras):
        angle = math.radians(45 * number)
        place = blender(3 * math.cos(angle), 3 * math.sin(angle), 0)
        np.testing.assert_allclose(camera.position, place, atol=1e-6)
        np.testing.assert_allclose(camera.forward, -camera.position / 3, atol=1e-6)
        # OpenCV's y is down, and the file's cameras are upright.
        np.testing.assert_allclose(camera.rotation[1], [0, -1, 0], atol=1e-6)
        assert camera.size == (1920, 1080)
        assert camera.K[0, 0] == camera.K[1, 1] == pytest.approx(2666.6667, abs=1e-3)
        assert camera.K[:2, 2].tolist() == [960, 540]
    # A subject that faces Blender's -Y: its face is nearest to camera 6, and not seen by camera 2.
    nose = blender(0, -0.1, 0)
    depths = [camera.project([nose])[1][0] for camera in cameras]
    assert np.argmin(depths) == 6
    assert np.argmax(depths) == 2


def with_first(**changes: object) -> list[dict]:
    entries = published(np.eye(4))
    entries[0] = {**entries[0], **changes}
    return entries


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], "no cameras"),
        ({"frames": []}, "not a published camera file .*TypeError"),
        ([1, 2], "not a published camera file .*TypeError"),
        ([{"location": [0, 0, 0]}], "not a published camera file .*KeyError"),
        (with_first(location=[1, 2]), "not a published camera file .*ValueError"),
        (with_first(quaternion=[0, 0, 0, 0]), "cameras.json: not a quaternion"),
        (with_first(quaternion=[1, 0, 0]), "cameras.json: not a quaternion"),
        (with_first(focal_length_px=-1), "cameras.json: camera K"),
        (with_first(quaternion=[1, 0, 0, 0]), "do not face the origin"),
    ],
)
def test_other_files_are_not_read_as_published_ones(
    tmp_path: Path, content: object, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        read_published_cameras(write(tmp_path / "cameras.json", content))


def test_a_missing_published_file_is_a_data_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="FileNotFoundError"):
        read_published_cameras(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("wxyz", "expected"),
    [
        ((1, 0, 0, 0), np.eye(3)),
        ((0, 1, 0, 0), np.diag([1, -1, -1])),
        ((0, 0, 0, -2), np.diag([-1, -1, 1])),
        ((math.sqrt(0.5), 0, 0, math.sqrt(0.5)), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    ],
)
def test_known_quaternions(wxyz: tuple, expected: object) -> None:
    np.testing.assert_allclose(rotation_from_quaternion(wxyz), expected, atol=1e-12)


@pytest.mark.parametrize("wxyz", [(0, 0, 0, 0), (1, 0, 0), (math.nan, 0, 0, 1), (math.inf,) * 4])
def test_what_is_not_a_quaternion(wxyz: tuple) -> None:
    with pytest.raises(DataError, match="not a quaternion"):
        rotation_from_quaternion(wxyz)


def test_blenders_camera_axes_differ_from_opencvs_by_a_half_turn_about_x() -> None:
    np.testing.assert_array_equal(OPENCV_TO_BLENDER_CAMERA, np.diag([1, -1, -1, 1]))
    # Our frontal camera stands on Blender's -Y, upright, and looks along Blender's +Y.
    pose = camera_to_blender(RIG[0])
    np.testing.assert_allclose(pose[:3, 3], [0, -3, 0], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 1], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(-pose[:3, 2], [0, 1, 0], atol=1e-12)


def test_as_many_images_as_cameras(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="shorter"):
        write_transforms_json(tmp_path / "t.json", RIG, ["one.png"])
    with pytest.raises(ValueError, match="shorter"):
        write_colmap(tmp_path, RIG, ["one.png"])
    assert list(tmp_path.iterdir()) == []
