"""Camera files of other programs, their lenses, and photos as cameras leave them."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from harness.core.cameras.camera import Camera, look_at
from harness.core.cameras.frames import write_colmap, write_transforms_json
from harness.core.cameras.rigs import RingRig
from harness.core.errors import DataError
from harness.data.captures.colmap import (
    read_colmap_binary,
    read_colmap_text,
    write_colmap_binary,
)
from harness.data.captures.lens import Lens, undistortion_map
from harness.data.captures.nerfstudio import read_nerfstudio
from harness.data.captures.pictures import find_mask, find_photos, read_photo
from harness.data.captures.published import read_published, write_published
from harness.data.captures.reading import find_cameras, read_cameras
from harness.data.captures.views import ForeignView

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
    with pytest.raises(DataError, match="camera model 7 is not known.*image_undistorter"):
        read_colmap_binary(tmp_path)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_a_truncated_model_is_told_wherever_it_ends(tmp_path, name):
    colmap_binary(tmp_path)
    content = (tmp_path / name).read_bytes()
    for end in range(8, len(content), 7):
        (tmp_path / name).write_bytes(content[:end])
        with pytest.raises(DataError, match="COLMAP model"):
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
    with pytest.raises(DataError, match="no camera file in.*--cameras"):
        find_cameras(images)
    write_colmap(tmp_path / "sparse" / "0", CAMERAS, NAMES)
    assert read_cameras(find_cameras(images)).layout == "COLMAP text"
    assert read_cameras(find_cameras(tmp_path)).layout == "COLMAP text"
    with pytest.raises(DataError, match="no camera file that is known"):
        read_cameras(images)


# Photos


def corners(width=60, height=40):
    """A picture whose red counts columns and whose green counts rows."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.stack([4 * x, 4 * y, 0 * x], axis=-1).astype(np.uint8)


@pytest.mark.parametrize(("orientation", "quarters"), [(1, 0), (3, 2), (6, 3), (8, 1)])
def test_a_photo_is_turned_as_its_file_says_with_its_camera(tmp_path, orientation, quarters):
    image = Image.fromarray(corners())
    exif = image.getexif()
    exif[274] = orientation
    image.save(tmp_path / "p.png", exif=exif)
    photo = read_photo(tmp_path / "p.png", ForeignView("p.png", camera()))
    np.testing.assert_array_equal(photo.rgb, np.rot90(corners(), quarters))
    points = np.array([[0.2, 0.1, 0.0], [-0.3, 0.25, 0.4]])
    before, _ = camera().project(points)
    after, _ = photo.camera.project(points)
    for old, new in zip(before.astype(int), after.astype(int), strict=True):
        assert photo.rgb[new[1], new[0]].tolist() == [4 * old[0], 4 * old[1], 0]


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
    with pytest.raises(DataError, match="not a complete picture"):
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
