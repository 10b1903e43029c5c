"""The border by example: the published file, nerfstudio and COLMAP, and what is refused."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.core.cameras.frames import (
    OPENCV_TO_BLENDER_CAMERA,
    camera_to_blender,
    quaternion_from_rotation,
    read_colmap,
    read_published_cameras,
    read_transforms_json,
    rotation_from_quaternion,
    write_colmap,
    write_transforms_json,
)
from harness.core.cameras.rigs import RingRig
from harness.core.errors import DataError

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


def nerfstudio(tmp_path: Path, change: Callable[[dict], object] | None = None) -> Path:
    path = tmp_path / "transforms.json"
    write_transforms_json(path, RIG[:2], ["rgb/00.png", "rgb/01.png"])
    document = json.loads(path.read_text())
    if change is not None:
        change(document)
    return write(path, document)


def test_intrinsics_may_stand_once_for_all_frames(tmp_path: Path) -> None:
    def share(document: dict) -> None:
        for frame in document["frames"]:
            for key in ("fl_x", "fl_y", "cx", "cy", "w", "h"):
                document[key] = frame.pop(key)
        del document["fl_y"]

    cameras, images = read_transforms_json(nerfstudio(tmp_path, share))

    assert images == ("rgb/00.png", "rgb/01.png")
    np.testing.assert_allclose(cameras[1].K, RIG[1].K)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(k1=0.01), "lens distortion .*got k1.*Undistort"),
        (lambda d: d["frames"][1].update(p2=-0.1), "lens distortion .*got p2"),
        (lambda d: d.update(camera_model="OPENCV_FISHEYE"), "OPENCV_FISHEYE.*Undistort"),
        (lambda d: d.pop("frames"), "not a nerfstudio .*KeyError: 'frames'"),
        (lambda d: d["frames"][0].pop("fl_x"), "not a nerfstudio .*KeyError: 'fl_x'"),
        (lambda d: d["frames"][0].pop("file_path"), "not a nerfstudio .*'file_path'"),
        (lambda d: d["frames"][0].update(transform_matrix=[[1, 0], [0, 1]]), "not a nerfstudio"),
        (lambda d: d["frames"][0].update(transform_matrix=3), "not a nerfstudio"),
        (lambda d: d["frames"][0].update(cx="middle"), "not a nerfstudio"),
        (lambda d: d["frames"].append("rgb/02.png"), "not a nerfstudio"),
        (lambda d: d["frames"][0].update(w=0), "transforms.json: camera has no pixels"),
        (
            lambda d: d["frames"][0].update(transform_matrix=np.diag([2.0, 2, 2, 1]).tolist()),
            "transforms.json: camera world_to_camera is not rigid",
        ),
    ],
)
def test_broken_or_bent_nerfstudio_files_are_refused(
    tmp_path: Path, change: Callable[[dict], object], message: str
) -> None:
    path = nerfstudio(tmp_path, change)

    with pytest.raises(DataError, match=message):
        read_transforms_json(path)


def test_zero_distortion_is_a_pinhole(tmp_path: Path) -> None:
    path = nerfstudio(tmp_path, lambda d: d.update(k1=0.0, k2=0, p1=0.0, camera_model="RADIAL"))

    assert len(read_transforms_json(path)[0]) == 2


def test_as_many_images_as_cameras(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="shorter"):
        write_transforms_json(tmp_path / "t.json", RIG, ["one.png"])
    with pytest.raises(ValueError, match="shorter"):
        write_colmap(tmp_path, RIG, ["one.png"])
    assert list(tmp_path.iterdir()) == []


#: As COLMAP writes it: a camera shared by two images, ids out of order, 2-D points.
CAMERAS_TXT = """\
# Camera list with one line of data per camera:
1 SIMPLE_PINHOLE 64 48 100 32 24
7 PINHOLE 64 48 100 110 32 24
"""
IMAGES_TXT = """\
# Image list with two lines of data per image:

2 1 0 0 0 0 0 3 7 b.png
10.5 11.5 -1 20.0 21.0 5
1 0.5 0.5 0.5 0.5 1 2 3 1 a picture.png

"""


def colmap(folder: Path, cameras: str = CAMERAS_TXT, images: str = IMAGES_TXT) -> Path:
    (folder / "cameras.txt").write_text(cameras)
    (folder / "images.txt").write_text(images)
    return folder


def test_a_colmap_model_is_read_in_order_of_image_id(tmp_path: Path) -> None:
    (first, second), names = read_colmap(colmap(tmp_path))

    assert names == ("a picture.png", "b.png")
    assert first.K.tolist() == [[100, 0, 32], [0, 100, 24], [0, 0, 1]]
    assert second.K[1, 1] == 110
    np.testing.assert_allclose(first.world_to_camera[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(first.rotation, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(second.position, [0, 0, -3])


@pytest.mark.parametrize(
    ("cameras", "images", "message"),
    [
        ("1 OPENCV 64 48 1 1 1 1 0 0 0 0\n", IMAGES_TXT, "model OPENCV .*image_undistorter"),
        ("1 PINHOLE 64 48 100 100\n", IMAGES_TXT, "not a COLMAP text model"),
        ("1 SIMPLE_PINHOLE 64 48\n", IMAGES_TXT, "not a COLMAP text model"),
        ("1 PINHOLE wide 48 100 100 1 1\n", IMAGES_TXT, "not a COLMAP text model"),
        ("2 PINHOLE 64 48 100 100 1 1\n", IMAGES_TXT, "not a COLMAP text model .*KeyError: '7'"),
        (CAMERAS_TXT, "1 1 0 0 0 0 0\n\n", "not a COLMAP text model"),
        (CAMERAS_TXT, "1 0 0 0 0 0 0 0 1 a.png\n\n", "images.txt: not a quaternion"),
        (CAMERAS_TXT, "1 1 0 0 0 0 0 nan 1 a.png\n\n", "images.txt: camera world_to_camera"),
    ],
)
def test_broken_or_bent_colmap_models_are_refused(
    tmp_path: Path, cameras: str, images: str, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        read_colmap(colmap(tmp_path, cameras, images))


def test_a_colmap_model_needs_both_files(tmp_path: Path) -> None:
    colmap(tmp_path)
    (tmp_path / "images.txt").unlink()

    with pytest.raises(DataError, match="FileNotFoundError"):
        read_colmap(tmp_path)
