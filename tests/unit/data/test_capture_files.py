"""Camera files of other programs, their lenses, and photos as cameras leave them."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageOps

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
    NamedPictures,
    Reading,
    find_mask,
    find_photos,
    fitting_readings,
    read_photo,
)

CAMERAS = RingRig(views=3, pitch_deg=10.0).cameras(36, 64)
NAMES = ("a.png", "b c.png", "d.png")


def camera(width=60, height=40, focal=50.0, middle=(33.0, 18.5)):
    K = np.array([[focal, 0, middle[0]], [0, 1.1 * focal, middle[1]], [0, 0, 1]])
    return Camera(K, look_at([0, 0, 3], [0, 0, 0]), width, height)


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


def corners(width=60, height=40):
    """A picture whose red counts columns and whose green counts rows."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.stack([4 * x, 4 * y, 0 * x], axis=-1).astype(np.uint8)


def blank(*paths):
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")


def test_a_photo_is_found_by_its_path_and_no_other(tmp_path):
    """``images`` may be in the path, or be the folder that the user named."""
    images, source = tmp_path / "images", tmp_path / "cameras" / "transforms.json"
    blank(images / "p.png", images / "cam1" / "p.png", images / "shot.jpg", source)
    found = NamedPictures(source, images)
    for name in ("p.png", "p", "./p.png", "images/p.png", "../images/p.png", "images\\p.png"):
        assert found.find(name).samefile(images / "p.png"), name
    assert found.find("images/cam1/p.png").samefile(images / "cam1" / "p.png")
    assert found.find("shot.png") == images / "shot.jpg"
    for name in ("cam0/p.png", "other/images/p.png", "shot.0001", "/data/p.png", "", ".", "\0"):
        assert found.find(name) is None, name


def test_a_photo_lies_in_the_folders_that_were_named(tmp_path):
    blank(tmp_path / "set" / "p.png", tmp_path / "private.png", tmp_path / "set" / "t.json")
    (tmp_path / "set" / "link.png").symlink_to(tmp_path / "private.png")
    inside = NamedPictures(tmp_path / "set" / "t.json", tmp_path / "set")
    for name in ("../private.png", "link.png", str(tmp_path / "private.png")):
        with pytest.raises(DataError, match="outside the folders that were given"):
            inside.find(name)
    assert NamedPictures(tmp_path / "set" / "t.json", tmp_path).find("../private.png")


def test_listed_photos_lie_in_their_folder(tmp_path):
    blank(tmp_path / "set" / "1.png", tmp_path / "private.png")
    (tmp_path / "again").symlink_to("set")
    assert [path.name for path in find_photos(tmp_path / "again")] == ["1.png"]
    (tmp_path / "set" / "2.png").symlink_to("../private.png")
    with pytest.raises(DataError, match="outside the folders that were given"):
        find_photos(tmp_path / "set")


def stored_as(orientation, shown):
    """The pixels that a file of an orientation stores of a picture; by EXIF's definition."""
    return {
        1: lambda p: p,
        2: lambda p: p[:, ::-1],
        3: lambda p: p[::-1, ::-1],
        4: lambda p: p[::-1],
        5: lambda p: np.swapaxes(p, 0, 1),
        6: lambda p: np.swapaxes(p, 0, 1)[::-1],
        7: lambda p: np.swapaxes(p, 0, 1)[::-1, ::-1],
        8: lambda p: np.swapaxes(p, 0, 1)[:, ::-1],
    }[orientation](shown)


def save_turned(path, orientation, stored):
    image = Image.fromarray(np.ascontiguousarray(stored))
    exif = image.getexif()
    exif[274] = orientation
    image.save(path, exif=exif)


@pytest.mark.parametrize("suffix", ["png", "tif", "webp"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_picture_turned_by_its_file_is_what_viewers_show(tmp_path, orientation, suffix):
    """The shown picture is that of Pillow's own viewer; camera and mask of either form fit."""
    path, mask_path = tmp_path / f"p.{suffix}", tmp_path / "m.png"
    shown, mask = corners(), np.zeros((40, 60), np.uint8)
    mask[5:30, 20:30] = 255
    save_turned(path, orientation, stored_as(orientation, shown))
    with Image.open(path) as image:
        seen = np.asarray(ImageOps.exif_transpose(image).convert("RGB")).astype(int)
    assert np.abs(seen - shown).mean() < 3 * (suffix == "webp") + 0.01
    view = ForeignView("p", camera())
    for mask_shown, pixels in ((True, mask), (False, stored_as(orientation, mask))):
        Image.fromarray(np.ascontiguousarray(pixels)).save(mask_path)
        photo = read_photo(path, view, mask_path, Reading(True, mask_shown))
        same(photo.camera, camera())
        np.testing.assert_array_equal(photo.rgb, seen)
        np.testing.assert_array_equal(photo.alpha, mask)
    save_turned(mask_path, orientation, stored_as(orientation, mask))
    np.testing.assert_array_equal(
        read_photo(path, view, mask_path, Reading(True, True)).alpha, mask
    )


@pytest.mark.parametrize(
    ("orientation", "fitting"),
    [(1, "ss st ts tt"), (3, "ss st ts tt"), (2, "ss st ts tt"), (6, "tt"), (7, "tt")],
)
def test_sizes_tell_stored_pictures_from_shown_ones(tmp_path, orientation, fitting):
    """Camera and mask are 60 x 40; ``s`` is stored, ``t`` is as viewers show it, of both."""
    save_turned(tmp_path / "p.png", orientation, stored_as(orientation, corners()))
    Image.fromarray(np.zeros((80, 120), np.uint8)).save(tmp_path / "m.png")
    found = fitting_readings(tmp_path / "p.png", ForeignView("p", camera()), tmp_path / "m.png")
    assert " ".join("st"[r.camera_shown] + "st"[r.mask_shown] for r in found) == fitting
    Image.fromarray(np.zeros((60, 30), np.uint8)).save(tmp_path / "m.png")
    with pytest.raises(DataError, match=r"m.png is of another shape than its photo.*got 30 x 60"):
        fitting_readings(tmp_path / "p.png", ForeignView("p", camera()), tmp_path / "m.png")


@pytest.mark.parametrize(("orientation", "quarters"), [(1, 0), (3, 2), (6, 3), (8, 1)])
def test_a_photo_is_turned_as_its_file_says_with_its_camera(tmp_path, orientation, quarters):
    save_turned(tmp_path / "p.png", orientation, corners())
    photo = read_photo(tmp_path / "p.png", ForeignView("p.png", camera()))
    np.testing.assert_array_equal(photo.rgb, np.rot90(corners(), quarters))
    points = np.array([[0.2, 0.1, 0.0], [-0.3, 0.25, 0.4]])
    before, _ = camera().project(points)
    after, _ = photo.camera.project(points)
    for old, new in zip(before.astype(int), after.astype(int), strict=True):
        assert photo.rgb[new[1], new[0]].tolist() == [4 * old[0], 4 * old[1], 0]


@pytest.mark.parametrize(
    ("name", "image", "colour"),
    [
        ("grey16.png", Image.fromarray(np.full((40, 60), 20000, np.uint16)), (78, 78, 78)),
        ("grey16.tif", Image.fromarray(np.full((40, 60), 50000, np.uint16)), (195, 195, 195)),
        ("grey.jpg", Image.new("L", (60, 40), 90), (90, 90, 90)),
        ("cmyk.jpg", Image.new("CMYK", (60, 40), (0, 255, 255, 0)), (255, 0, 0)),
        ("palette.png", Image.new("RGB", (60, 40), (0, 255, 51)).convert("P"), (0, 255, 51)),
        ("two.png", Image.new("1", (60, 40), 1), (255, 255, 255)),
        ("alpha.png", Image.new("RGBA", (60, 40), (10, 200, 30, 128)), (10, 200, 30)),
        ("clear.png", Image.new("LA", (60, 40), (50, 0)), (50, 50, 50)),
    ],
)  # fmt: skip
def test_photos_of_every_kind_are_read_by_value(tmp_path, name, image, colour):
    """Alpha that is the same everywhere cuts nothing out."""
    image.save(tmp_path / name)
    photo = read_photo(tmp_path / name, ForeignView(name, camera()))
    assert photo.alpha is None
    assert np.abs(photo.rgb.astype(int) - colour).max() <= 1


def test_a_photo_is_read_by_its_content_not_its_name(tmp_path):
    Image.fromarray(corners()).save(tmp_path / "p.jpg", "PNG")
    photo = read_photo(tmp_path / "p.jpg", ForeignView("p.jpg", camera()))
    np.testing.assert_array_equal(photo.rgb, corners())


def test_a_camera_of_the_turned_picture_is_believed(tmp_path):
    image = Image.fromarray(corners())
    exif = image.getexif()
    exif[274] = 6
    image.save(tmp_path / "p.png", exif=exif)
    standing = camera(40, 60, middle=(20.0, 30.0))
    photo = read_photo(tmp_path / "p.png", ForeignView("p.png", standing))
    same(photo.camera, standing)
    np.testing.assert_array_equal(photo.rgb, np.rot90(corners(), 3))


def test_a_smaller_photo_takes_its_camera_along(tmp_path):
    Image.fromarray(corners()[::2, ::2]).save(tmp_path / "p.png")
    photo = read_photo(tmp_path / "p.png", ForeignView("p.png", camera()))
    same(photo.camera, camera().resized(30, 20))


def test_a_photo_of_another_shape_is_told(tmp_path):
    Image.fromarray(corners(60, 30)).save(tmp_path / "p.png")
    with pytest.raises(DataError, match="another shape than its camera.*60 x 40.*60 x 30"):
        read_photo(tmp_path / "p.png", ForeignView("p.png", camera()))


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA"])
def test_a_mask_file_says_where_the_subject_is(tmp_path, mode):
    Image.fromarray(corners()).save(tmp_path / "p.jpg")
    mask = np.zeros((40, 60), np.uint8)
    mask[10:30, 20:40] = 255
    if mode == "RGBA":
        picture = Image.fromarray(np.dstack([corners(), mask]))
    else:
        picture = Image.fromarray(mask).convert(mode)
    (tmp_path / "masks").mkdir()
    picture.save(tmp_path / "masks" / "p.jpg.png")
    found = find_mask(tmp_path / "masks", tmp_path / "p.jpg")
    photo = read_photo(tmp_path / "p.jpg", ForeignView("p.jpg", camera()), found)
    np.testing.assert_array_equal(photo.alpha, mask)


def subject(shape=(40, 60)):
    inside = np.zeros(shape, bool)
    inside[10:30, 20:40] = True
    return inside


def soft(top):
    """A mask with a soft edge of one pixel, up to a number."""
    edge = np.asarray(Image.fromarray(255 * subject().astype(np.uint8)).resize((60, 40)))
    ramp = (0.3 * np.roll(edge, 1, axis=1) + 0.7 * edge) / 255
    return np.maximum(ramp, subject()) * top


def layers(*values):
    return np.dstack([np.broadcast_to(value, (40, 60)) for value in values]).astype(np.uint8)


PALETTE = Image.fromarray(subject().astype(np.uint8), "L").convert("P")
PALETTE.putpalette([0, 0, 0, 128, 0, 0])
#: Name, picture, and whether it is white around the subject.
MASKS = [
    ("0/1", subject().astype(np.uint8), False),
    ("0/127", 127 * subject().astype(np.uint8), False),
    ("0/127 soft", soft(127).astype(np.uint8), False),
    ("0/255", 255 * subject().astype(np.uint8), False),
    ("0/2", 2 * subject().astype(np.uint8), False),
    ("16-bit", (65535 * subject()).astype(np.uint16), False),
    ("16-bit soft", soft(65535).astype(np.uint16), False),
    ("16-bit 0/1", subject().astype(np.uint16), False),
    ("16-bit 0/255 soft", soft(255).astype(np.uint16), False),
    ("two colours", subject(), False),
    ("palette", PALETTE, False),
    ("one colour", layers(192 * subject(), 128 * subject(), 0), False),
    ("RGBA, alpha 255", layers(*[255 * subject()] * 3, 255), False),
    ("RGBA, alpha 128", layers(*[255 * subject()] * 3, 128), False),
    ("RGBA, alpha 0", layers(*[subject()] * 3, 0), False),
    ("LA, alpha 255", layers(127 * subject(), 255), False),
    ("alpha 0/1", layers(0, 0, 0, subject()), False),
    ("inverted", 255 * (~subject()).astype(np.uint8), True),
    ("inverted 0/1", (~subject()).astype(np.uint8), True),
    ("inverted soft", (255 - soft(255)).astype(np.uint8), True),
    ("inverted 16-bit", (65535 - soft(65535)).astype(np.uint16), True),
]  # fmt: skip


@pytest.mark.parametrize(("name", "mask", "inverted"), MASKS, ids=[name for name, *_ in MASKS])
def test_masks_of_every_kind_say_where_the_subject_is(tmp_path, name, mask, inverted):
    Image.fromarray(corners()).save(tmp_path / "p.png")
    (mask if isinstance(mask, Image.Image) else Image.fromarray(mask)).save(tmp_path / "m.png")
    photo = read_photo(tmp_path / "p.png", ForeignView("p.png", camera()), tmp_path / "m.png")
    np.testing.assert_array_equal(
        photo.alpha >= 128, subject() | (soft(255) >= 128 if "soft" in name else False)
    )
    assert (photo.alpha[subject()] == 255).all()
    assert photo.inverted is inverted


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        (np.arange(3, dtype=np.uint8).repeat(800).reshape(40, 60), "one subject.*from 0 to 2"),
        (np.where(subject(), 2, 1).astype(np.uint8), "one subject.*2 numbers from 1 to 2"),
        (soft(4095).astype(np.uint16), "no mask of one subject.*from 0 to 4095"),
        (np.where(subject(), 255, 100).astype(np.uint8), "one subject.*2 numbers from 100 to 255"),
        (np.full((40, 60), 255, np.uint8), "covers the whole picture"),
        (np.full((40, 60), 1, np.uint8), "covers the whole picture"),
        (np.full((40, 60), 70000, np.int32), "no mask of one subject.*70000"),
    ],
)  # fmt: skip
def test_what_is_no_mask_is_told(tmp_path, mask, message):
    Image.fromarray(corners()).save(tmp_path / "p.png")
    Image.fromarray(mask).save(tmp_path / "m.tif")
    with pytest.raises(DataError, match=f"m.tif .*{message}"):
        read_photo(tmp_path / "p.png", ForeignView("p.png", camera()), tmp_path / "m.tif")


def test_what_lies_behind_a_cut_out_does_not_bleed_into_it(tmp_path):
    rgba = np.zeros((40, 60, 4), np.uint8)
    rgba[10:30, 20:40] = (200, 100, 50, 255)
    Image.fromarray(rgba).save(tmp_path / "p.png")
    view = ForeignView("p.png", camera(), Lens.of((-0.1,)))
    bent = read_photo(tmp_path / "p.png", view)
    small = replace(bent).resized(23)
    for photo in (bent, small):
        assert photo.alpha is not None
        shown = photo.alpha > 2
        assert np.abs(photo.rgb[shown].astype(int) - (200, 100, 50)).max() <= 1


@pytest.mark.parametrize("content", [b"", b"no picture", b"\x89PNG\r\n\x1a\n1234"])
def test_a_damaged_photo_is_told(tmp_path, content):
    (tmp_path / "p.png").write_bytes(content)
    with pytest.raises(DataError, match="not a complete image"):
        read_photo(tmp_path / "p.png", ForeignView("p.png", camera()))


def test_photos_are_in_natural_order(tmp_path):
    for name in ("p10.jpg", "p9.jpg", "p1.JPG", "note.txt"):
        (tmp_path / name).write_bytes(b"")
    assert [path.name for path in find_photos(tmp_path)] == ["p1.JPG", "p9.jpg", "p10.jpg"]


def test_a_photo_is_not_its_own_mask(tmp_path):
    for name in ("0001.jpg", "0001_mask.png", "0002.png"):
        (tmp_path / name).write_bytes(b"")
    assert find_mask(tmp_path, tmp_path / "0001.jpg") == tmp_path / "0001_mask.png"
    assert find_mask(tmp_path, tmp_path / "0002.png") is None
