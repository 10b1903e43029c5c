"""Camera files of other programs, their lenses, and photos as cameras leave them."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from PIL import Image

from harness.core.camera import Camera, look_at
from harness.core.camera_frames import write_colmap, write_transforms_json
from harness.core.errors import DataError
from harness.core.rigs import RingRig
from harness.data.camera_files import (
    camera_file,
    read_cameras,
    read_nerfstudio,
    read_published,
    write_published,
)
from harness.data.colmap import read_colmap_binary, read_colmap_text, write_colmap_binary
from harness.data.lens import ForeignView, Lens, undistortion_map
from harness.data.pictures import (
    read_photo,
)

CAMERAS = RingRig(views=3, pitch_deg=10.0).cameras(36, 64)
NAMES = ("a.png", "b c.png", "d.png")


def camera(width=60, height=40, focal=50.0, middle=(33.0, 18.5)):
    K = np.array([[focal, 0, middle[0]], [0, 1.1 * focal, middle[1]], [0, 0, 1]])
    return Camera(K, look_at([0, 0, 3], [0, 0, 0]), width, height)


def corners(width=60, height=40):
    """A picture whose red counts columns and whose green counts rows."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.stack([4 * x, 4 * y, 0 * x], axis=-1).astype(np.uint8)


def same(found, expected):
    assert found.size == expected.size
    np.testing.assert_allclose(found.K, expected.K, atol=1e-9)
    np.testing.assert_allclose(found.world_to_camera, expected.world_to_camera, atol=1e-9)


# Lenses


@pytest.mark.parametrize(
    ("lens", "at", "expected"),
    [
        (Lens(), (0.3, -0.4), (0.3, -0.4)),
        # r = 0.5: 1 + k r^2 = 1.1 with k = 0.4
        (Lens.of((0.4,)), (0.3, -0.4), (0.33, -0.44)),
        # 1 + 0.4 / 4 + 0.8 / 16 = 1.15
        (Lens.of((0.4, 0.8)), (0.3, -0.4), (0.345, -0.46)),
        # p1: x + 2 p1 x y, y + p1 (r^2 + 2 y^2)
        (Lens.of((), (0.1, 0.0)), (0.3, -0.4), (0.276, -0.343)),
        (Lens.of((), (0.0, 0.1)), (0.3, -0.4), (0.343, -0.424)),
        # (1 + 0.1) / (1 + 0.25): k1 = 0.4, k4 = 1
        (Lens.of((0.4, 0, 0, 1.0)), (0.3, -0.4), (0.264, -0.352)),
        # a fisheye without terms sees a point at 45 degrees at pi / 4
        (Lens.of((), fisheye=True), (1.0, 0.0), (np.pi / 4, 0.0)),
    ],
)
def test_a_lens_puts_points_where_its_formula_does(lens, at, expected):
    np.testing.assert_allclose(lens.distorted(np.array([at]))[0], expected, atol=1e-12)


def test_a_polynomial_that_folds_back_shows_nothing_beyond():
    # r (1 - r^2) is largest at 1 / sqrt(3).
    points = np.array([[0.5, 0.0], [0.57, 0.0], [0.6, 0.0], [1.2, 0.0]])
    assert Lens.of((-1.0,)).sees(points).tolist() == [True, True, False, False]


def waves(pixels):
    """A smooth picture (N, 3) of directions (N, 2)."""
    x, y = pixels.T
    return np.stack([np.sin(9 * x), np.cos(7 * y), np.sin(5 * x + 6 * y)], axis=1) * 100 + 128


LENSES = [
    Lens.of((-0.15,)),
    Lens.of((-0.12, 0.03)),
    Lens.of((0.1, -0.02, 0.01), (0.004, -0.006)),
    Lens.of((0.05, -0.01), fisheye=True),
]


@pytest.mark.parametrize("lens", LENSES)
def test_what_a_lens_did_is_undone(tmp_path, lens):
    view = ForeignView("p.png", camera(240, 160, 200.0, (128.0, 77.0)), lens)
    focal, middle = view.camera.K[[0, 1], [0, 1]], view.camera.K[:2, 2]
    seen = (view.camera.pixel_centres().reshape(-1, 2) - middle) / focal
    straight = seen.copy()
    for _ in range(60):  # where the lens sees: the inverse by fixed points
        straight += seen - lens.distorted(straight)
    taken = np.round(waves(straight)).reshape(160, 240, 3).astype(np.uint8)
    Image.fromarray(taken).save(tmp_path / "p.png")

    photo = read_photo(tmp_path / "p.png", view)

    same(photo.camera, view.camera)
    assert photo.alpha is None
    expected = waves((photo.camera.pixel_centres().reshape(-1, 2) - middle) / focal)
    whole = photo.shown == 255
    assert whole.mean() > 0.8
    error = np.abs(photo.rgb - expected.reshape(160, 240, 3))[whole]
    assert error.mean() < 0.6
    assert np.percentile(error, 99) < 2.5


def test_a_pinhole_is_left_alone():
    places, seen = undistortion_map(camera(), Lens())
    np.testing.assert_allclose(places, camera().pixel_centres(), atol=1e-9)
    assert seen.all()


# Camera files


def test_a_binary_model_is_the_text_model(tmp_path):
    write_colmap(tmp_path / "text", CAMERAS, NAMES)
    write_colmap_binary(tmp_path / "binary", CAMERAS, NAMES)
    text, binary = read_colmap_text(tmp_path / "text"), read_colmap_binary(tmp_path / "binary")
    assert [view.image for view in binary.views] == [view.image for view in text.views] == [*NAMES]
    for one, other, true in zip(text.views, binary.views, CAMERAS, strict=True):
        same(one.camera, true)
        same(other.camera, true)
    assert read_cameras(tmp_path / "binary").layout == "COLMAP binary"
    assert read_cameras(tmp_path / "text" / "images.txt").layout == "COLMAP text"


def colmap_binary(folder, model=3, numbers=(50.0, 30.0, 20.0, 0.1, 0.02)):
    """A model of one camera and two images with 2-D points, written by hand."""
    camera_entry = struct.pack(f"<QIiQQ{len(numbers)}d", 1, 7, model, 60, 40, *numbers)
    images = struct.pack("<Q", 2)
    for number, name in ((9, b"late.jpg"), (2, b"early.jpg")):
        images += struct.pack("<I7dI", number, 1, 0, 0, 0, 0.1, 0.2, 3.0, 7) + name + b"\0"
        images += struct.pack("<Q", 2) + 2 * struct.pack("<ddq", 1.0, 2.0, -1)
    (folder / "cameras.bin").write_bytes(camera_entry)
    (folder / "images.bin").write_bytes(images)


def test_a_binary_model_has_lenses_points_and_its_own_order(tmp_path):
    colmap_binary(tmp_path)
    found = read_colmap_binary(tmp_path)
    assert [view.image for view in found.views] == ["early.jpg", "late.jpg"]
    view = found.views[0]
    assert view.lens == Lens.of((0.1, 0.02))
    np.testing.assert_allclose(view.camera.K, [[50, 0, 30], [0, 50, 20], [0, 0, 1]])
    np.testing.assert_allclose(view.camera.world_to_camera[:3, 3], [0.1, 0.2, 3.0])


@pytest.mark.parametrize(
    ("model", "numbers", "lens"),
    [
        (0, (50.0, 30, 20), Lens()),
        (1, (50.0, 55, 30, 20), Lens()),
        (2, (50.0, 30, 20, 0.1), Lens.of((0.1,))),
        (4, (50.0, 55, 30, 20, 0.1, 0.2, 0.3, 0.4), Lens.of((0.1, 0.2), (0.3, 0.4))),
        (5, (50.0, 55, 30, 20, 0.1, 0.2, 0.3, 0.4), Lens.of((0.1, 0.2, 0.3, 0.4), fisheye=True)),
        (
            6,
            (50.0, 55, 30, 20, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8),
            Lens.of((0.1, 0.2, 0.5, 0.6, 0.7, 0.8), (0.3, 0.4)),
        ),
    ],
)
def test_models_of_cameras_are_those_of_colmap(tmp_path, model, numbers, lens):
    colmap_binary(tmp_path, model, numbers)
    assert read_colmap_binary(tmp_path).views[0].lens == lens


def test_an_unknown_model_of_cameras_is_told(tmp_path):
    colmap_binary(tmp_path, 7, (50.0, 55, 30, 20, 0.1))
    with pytest.raises(DataError, match="camera model FOV is not known.*image_undistorter"):
        read_colmap_binary(tmp_path)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_a_truncated_model_is_told_wherever_it_ends(tmp_path, name):
    colmap_binary(tmp_path)
    content = (tmp_path / name).read_bytes()
    for end in range(8, len(content), 7):
        (tmp_path / name).write_bytes(content[:end])
        with pytest.raises(DataError, match="COLMAP model"):
            read_colmap_binary(tmp_path)


def colmap_text(
    folder, cameras="1 PINHOLE 64 48 100 110 32 24\n", images="1 1 0 0 0 0 0 3 1 a.png\n"
):
    (folder / "cameras.txt").write_text(cameras)
    (folder / "images.txt").write_text(images)
    return folder


IMAGE = "{} 1 0 0 0 0 0 3 1 {}.png\n"


@pytest.mark.parametrize(
    ("cameras", "images", "message"),
    [
        ("1 OPENCV 64 48 9 9 9 9 0 0\n", None, "line 1: .*OPENCV has 6 parameters.*expected 8"),
        ("1 PINHOLE 64 48 100 100\n", None, "PINHOLE has 2 parameters.*expected 4"),
        ("1 SIMPLE_PINHOLE 64 48\n", None, "SIMPLE_PINHOLE has 0 parameters.*expected 3.*none"),
        ("1 SIMPLE_RADIAL 64 48 9 9 9 0 0\n", None, "SIMPLE_RADIAL has 5 parameters.*expected 4"),
        (
            "1 PINHOLE wide 48 100 100 1 1\n",
            None,
            "cameras.txt, line 1 cannot be read.*'?1 PINHOLE",
        ),
        ("\n1 PINHOLE\n", None, "cameras.txt, line 2 cannot be read.*WIDTH"),
        (
            "1 THIN_PRISM_FISHEYE 6 4 1 1 1 1\n",
            None,
            "camera model THIN_PRISM_FISHEYE is not known",
        ),
        ("1 OPENCV 64 48 9 9 9 9 nan 0 0 0\n", None, "lens is not of finite numbers"),
        ("2 PINHOLE 64 48 9 9 1 1\n", None, "image 1, 'a.png': .*camera 1, which.*one of 2"),
        ("", None, "image 1, 'a.png': .*camera 1, which the model does not have.*none"),
        ("1 PINHOLE 64 48 9 9 1 1\n" * 2, None, "cameras.txt has two entries of number 1"),
        (
            None,
            IMAGE.format(3, "a") + IMAGE.format(3, "b"),
            "images.txt has two entries of number 3",
        ),
        (None, "1 1 0 0 0 0 0\n\n", "images.txt, line 1 cannot be read.*QW QX"),
        (None, "1 0 0 0 0 0 0 0 1 a.png\n\n", "image 1, 'a.png': not a quaternion"),
        (None, "1 1 0 0 0 0 0 nan 1 a.png\n\n", "image 1, 'a.png': camera world_to_camera"),
        (None, IMAGE.format(1, "a") + "1.5 2.5\n", "images.txt, line 2 cannot be read"),
        (None, IMAGE.format(1, "a") + "1.5 2.5 -1 7.5\n", "images.txt, line 2 cannot be read"),
        (
            None,
            "# Number of images: 8\n" + IMAGE.format(1, "a"),
            "images.txt says .* 8 entries.*got 1",
        ),
        ("# Number of cameras: 2\n1 PINHOLE 64 48 9 9 1 1\n", None, "says that it has 2 entries"),
        (None, "# nothing\n", "has no images"),
    ],
)
def test_a_text_model_that_is_not_whole_is_told_where(tmp_path, cameras, images, message):
    given = {"cameras": cameras, "images": images}
    colmap_text(tmp_path, **{name: text for name, text in given.items() if text is not None})
    with pytest.raises(DataError, match=message):
        read_colmap_text(tmp_path)


@pytest.mark.parametrize(
    "between",
    ["\n", "", "\n\n", "10.5 11.5 -1 20.0 21.0 5\n", "1 2 3 4 5 6 7 8 9 10 11 12\n", "# note\n"],
)
def test_lines_of_points_may_be_full_empty_or_missing(tmp_path, between):
    images = "".join(IMAGE.format(n, f"photo {n} of 4") + between for n in range(1, 5))
    for text in (images, f"\ufeff# head\n{images}", images.replace("\n", "\r\n"), images.rstrip()):
        (tmp_path / "images.txt").write_bytes(text.encode())
        (tmp_path / "cameras.txt").write_text("\ufeff1 PINHOLE 64 48 100 110 32 24\n")
        found = [view.image for view in read_colmap_text(tmp_path).views]
        assert found == [f"photo {n} of 4.png" for n in range(1, 5)]


def test_bytes_after_the_last_entry_are_told(tmp_path):
    colmap_binary(tmp_path)
    with (tmp_path / "images.bin").open("ab") as file:
        file.write(b"more")
    with pytest.raises(DataError, match="not a COLMAP model.*4 bytes after the last entry"):
        read_colmap_binary(tmp_path)


def nerfstudio(path, **more):
    write_transforms_json(path, CAMERAS, NAMES)
    document = json.loads(path.read_text())
    document.update(more)
    path.write_text(json.dumps(document))
    return document


def test_a_transforms_file_keeps_its_own_axes_and_lens(tmp_path):
    path = tmp_path / "transforms.json"
    nerfstudio(path, k1=0.1, k2=0.2, p1=0.3, p2=0.4)
    found = read_nerfstudio(path)
    assert {view.lens for view in found.views} == {Lens.of((0.1, 0.2), (0.3, 0.4))}
    # The file's world has +Z up: a camera that is lifted has a greater z.
    for view, true in zip(found.views, CAMERAS, strict=True):
        x, y, z = true.position
        np.testing.assert_allclose(view.camera.position, [x, -z, y], atol=1e-9)


def test_a_mirrored_pose_is_told(tmp_path):
    path = tmp_path / "transforms.json"
    document = nerfstudio(path)
    matrix = np.array(document["frames"][1]["transform_matrix"])
    matrix[:3, 0] *= -1
    document["frames"][1]["transform_matrix"] = matrix.tolist()
    path.write_text(json.dumps(document))
    with pytest.raises(DataError, match="frame 1.*not rigid.*mirrored"):
        read_nerfstudio(path)


@pytest.mark.parametrize("text", ["{", "{}", '{"frames": [{}]}', '{"frames": []}', "[]", "[1]"])
def test_a_damaged_camera_file_is_told(tmp_path, text):
    path = tmp_path / "transforms.json"
    path.write_text(text)
    with pytest.raises(DataError, match="transforms.json"):
        read_cameras(path)


def frames(path, *names, document=None, **more):
    """A file of cameras one in front of the other, with what all and each frame say of them."""
    pose = np.eye(4).tolist()
    every = [{"file_path": name, "transform_matrix": pose, **more} for name in names]
    path.write_bytes(json.dumps({**(document or {}), "frames": every}).encode("utf-8-sig"))
    return path


INTRINSICS = {"fl_x": 50.0, "fl_y": 55.0, "cx": 33.0, "cy": 18.5, "w": 60, "h": 40}


@pytest.mark.parametrize(
    ("document", "frame", "expected"),
    [
        # f = w / 2 / tan(angle / 2) of the photo's 60 x 40 pixels, and the middle.
        ({"camera_angle_x": np.pi / 2}, {}, (30.0, 30.0, 30.0, 20.0)),
        ({"camera_angle_x": np.pi / 2, "camera_angle_y": np.pi / 2}, {}, (30.0, 20.0, 30.0, 20.0)),
        ({"camera_angle_x": np.pi / 2, "w": 120, "h": 80}, {}, (60.0, 60.0, 60.0, 40.0)),
        ({}, {"camera_angle_x": np.pi / 2, "cx": 29.0}, (30.0, 30.0, 29.0, 20.0)),
        ({"camera_angle_x": 0.6, "fl_x": 50.0}, {}, (50.0, 50.0, 30.0, 20.0)),
        ({"fl_x": 50.0, "fl_y": 55.0}, {"camera_angle_x": np.pi / 2}, (30.0, 30.0, 30.0, 20.0)),
        ({"fl_x": 50.0, "cx": 33.0, "cy": 18.5}, {"fl_x": 70.0}, (70.0, 70.0, 33.0, 18.5)),
        (INTRINSICS, {}, (50.0, 55.0, 33.0, 18.5)),
    ],
)
def test_what_a_file_does_not_say_comes_from_the_photo(tmp_path, document, frame, expected):
    Image.fromarray(corners()).save(tmp_path / "p.png")
    path = frames(tmp_path / "transforms.json", "./p", document=document, **frame)
    K = read_cameras(path).views[0].camera.K
    np.testing.assert_allclose((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), expected)


def test_without_any_photo_a_size_that_is_missing_is_told(tmp_path):
    path = frames(tmp_path / "transforms.json", "a.png", "b.png", camera_angle_x=0.6)
    with pytest.raises(DataError, match="frame 0: no w and h, and no photo is there"):
        read_cameras(path)
    Image.fromarray(corners()).save(tmp_path / "b.png")
    assert [view.camera.size for view in read_cameras(path).views] == [(60, 40), (60, 40)]


@pytest.mark.parametrize(
    ("more", "lens"),
    [
        ({"is_fisheye": True, "k1": 0.1, "k4": 0.4}, Lens.of((0.1, 0, 0, 0.4), fisheye=True)),
        ({"is_fisheye": True, "camera_model": "OPENCV_FISHEYE"}, Lens.of((), fisheye=True)),
        ({"camera_model": "OPENCV_FISHEYE", "k2": 0.2}, Lens.of((0, 0.2), fisheye=True)),
        ({"is_fisheye": False, "k3": 0.3}, Lens.of((0, 0, 0.3))),
        ({"camera_model": None, "p2": 0.1, "k4": 0.0}, Lens.of((), (0.0, 0.1))),
    ],
)
def test_fisheyes_are_told_in_two_ways(tmp_path, more, lens):
    path = frames(tmp_path / "t.json", "p.png", document=more, **INTRINSICS)
    assert read_nerfstudio(path).views[0].lens == lens


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"k4": 0.1}, "lens with k4 is not known.*k4 = 0.1"),
        ({"k5": 0.1}, "lens with k5 is not known"),
        ({"is_fisheye": True, "p1": 0.1}, "lens with p1 is not known"),
        ({"camera_model": "FISHEYE624"}, "camera model FISHEYE624 is not known.*OPENCV_FISHEYE"),
        ({"camera_model": "EQUIRECTANGULAR"}, "camera model EQUIRECTANGULAR is not known"),
        ({"camera_model": "OPENCV", "is_fisheye": True}, "OPENCV with is_fisheye True"),
        ({"camera_model": "OPENCV_FISHEYE", "is_fisheye": False}, "with is_fisheye False"),
        ({"ftheta_p0": 0.1}, "camera model ftheta_p0 is not known"),
        ({"latlong": True}, "camera model latlong is not known"),
        (
            {"distortion_params": [0.1, 0, 0, 0, 0, 0]},
            "camera model distortion_params is not known",
        ),
        ({"distortion": [0.1, 0, 0, 0]}, "camera model distortion is not known"),
        ({"rolling_shutter": [0, 0, 0.01, 0]}, "camera model rolling_shutter is not known"),
        ({"fl_x": "long"}, "frame 0: fl_x is no number.*'long'"),
        ({"fl_x": None, "fl_y": None}, "no focal length.*camera_angle_x in radians"),
        ({"fl_x": None, "fl_y": None, "camera_angle_x": 35.6}, "no angle in radians.*35.6"),
        (
            {"camera_model": "ORTHOPHOTO", "fl_x": None, "fl_y": None, "camera_angle_x": 0.6},
            "no focal length",
        ),
        ({"camera_model": "ORTHOPHOTO", "k1": 0.1}, "distortion in front of parallel rays"),
        ({"cx": "middle"}, "cx is no number"),
        ({"w": 0}, "camera has no pixels"),
        ({"file_path": None}, "file_path is no text"),
        ({"transform_matrix": [[1, 0], [0, 1]]}, "no transform_matrix from camera to world"),
        ({"transform_matrix": np.diag([2.0, 2, 2, 1]).tolist()}, "frame 0.*not rigid"),
        (
            {"transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 2, 3, 1]]},
            "last of them 0 0 0 1.*1, 2, 3, 1",
        ),
    ],
)
def test_what_a_transforms_file_may_not_say_is_told(tmp_path, more, message):
    with pytest.raises(DataError, match=message):
        read_nerfstudio(frames(tmp_path / "t.json", "p.png", **{**INTRINSICS, **more}))


def test_the_published_form_comes_back(tmp_path):
    path = tmp_path / "camera_parameters.json"
    write_published(path, CAMERAS)
    found = read_published(path)
    for view, true in zip(found.views, CAMERAS, strict=True):
        x, y, z = true.position
        np.testing.assert_allclose(view.camera.position, [x, -z, y], atol=1e-9)
        np.testing.assert_allclose(view.camera.K, true.K)
    assert not found.is_named
    with pytest.raises(DataError, match="centre"):
        write_published(path, [camera()])


def test_a_published_file_is_what_it_was(published_camera_file, tmp_path):
    views = read_published(published_camera_file).views
    entries = json.loads(published_camera_file.read_text())
    assert views[0].camera.size == (1920, 1080)
    for view, entry in zip(views, entries, strict=True):
        np.testing.assert_allclose(view.camera.position, entry["location"], atol=1e-6)


def test_camera_files_are_found_where_they_usually_lie(tmp_path):
    images = tmp_path / "images"
    images.mkdir()
    assert camera_file(images) == ""
    assert camera_file(images, tmp_path / "mine.json") == str(tmp_path / "mine.json")
    write_colmap(tmp_path / "sparse" / "0", CAMERAS, NAMES)
    assert read_cameras(camera_file(images)).layout == "COLMAP text"
    assert read_cameras(camera_file(tmp_path)).layout == "COLMAP text"
    with pytest.raises(DataError, match="no camera file that is known"):
        read_cameras(images)


# Photos
