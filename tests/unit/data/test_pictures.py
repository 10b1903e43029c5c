"""Photos and masks of captures: found by names, turned as files say, read by their content."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageOps

from harness.core.errors import DataError
from harness.data.lens import ForeignView, Lens
from harness.data.pictures import (
    NamedPictures,
    Reading,
    find_mask,
    find_photos,
    fitting_readings,
    read_photo,
)
from tests.unit.data.test_capture_files import camera, corners, same


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
