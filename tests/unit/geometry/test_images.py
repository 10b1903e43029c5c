"""Pictures: what is written comes back, and every defect is a sentence."""

import numpy as np
import pytest
from PIL import Image

from harness.core.errors import DataError
from harness.geometry.images import (
    composite,
    linear_from_srgb,
    load_mask,
    load_rgb,
    load_rgba,
    resampled,
    save_png,
    srgb_from_linear,
)


@pytest.fixture
def rgba():
    return np.random.default_rng(0).integers(0, 256, (40, 30, 4), dtype=np.uint8)


def test_what_is_written_comes_back(tmp_path, rgba):
    path = tmp_path / "a.png"
    save_png(path, rgba)
    assert np.array_equal(load_rgba(path, (30, 40)), rgba)
    assert np.array_equal(load_mask(path), rgba[..., 3] / 255)
    assert [file.name for file in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize("lost", [12, 13, 500, 4000])
def test_a_truncated_png_is_refused(tmp_path, rgba, lost):
    path = tmp_path / "a.png"
    save_png(path, rgba)
    path.write_bytes(path.read_bytes()[:-lost])
    with pytest.raises(DataError, match=r"a\.png is not a complete PNG.*truncated"):
        load_rgba(path)


def test_a_flipped_byte_is_refused(tmp_path, rgba):
    path = tmp_path / "a.png"
    save_png(path, rgba)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(DataError, match="not a complete PNG"):
        load_rgba(path)


def test_each_defect_has_its_sentence(tmp_path, rgba):
    with pytest.raises(DataError, match="no image at"):
        load_rgba(tmp_path / "none.png")
    save_png(tmp_path / "rgb.png", rgba[..., :3])
    with pytest.raises(DataError, match=r"no alpha channel.*got mode RGB"):
        load_rgba(tmp_path / "rgb.png")
    save_png(tmp_path / "a.png", rgba)
    with pytest.raises(DataError, match="expected 31 x 40 pixels; got 30 x 40"):
        load_rgba(tmp_path / "a.png", (31, 40))
    Image.fromarray(rgba).save(tmp_path / "b.png", format="TIFF")
    with pytest.raises(DataError, match="not a complete PNG"):
        load_rgba(tmp_path / "b.png")
    (tmp_path / "t.jpg").write_bytes(b"\xff\xd8\xff\xe0 nothing")
    with pytest.raises(DataError, match="not a complete image"):
        load_rgb(tmp_path / "t.jpg")


SIXTEEN, EIGHT = np.array([[0, 20000, 50000, 65535]]), np.array([[0, 78, 195, 255]], np.uint8)


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("grey16.png", Image.fromarray(SIXTEEN.astype(np.uint16))),
        ("grey16.tif", Image.fromarray(SIXTEEN.astype(np.uint16))),
        ("big.tif", Image.fromarray(SIXTEEN.astype(">u2"))),
        ("wide.tif", Image.fromarray(SIXTEEN.astype(np.int32))),
        ("grey.png", Image.fromarray(EIGHT)),
        ("alpha.png", Image.merge("LA", [Image.fromarray(EIGHT), Image.fromarray(255 - EIGHT)])),
        ("palette.png", Image.fromarray(EIGHT).convert("P")),
        ("cmyk.tif", Image.fromarray(EIGHT).convert("CMYK")),
    ],
)
def test_textures_of_every_kind_are_read_by_value(tmp_path, name, image):
    image.save(tmp_path / name)
    np.testing.assert_array_equal(load_rgb(tmp_path / name), np.stack([EIGHT] * 3, axis=-1))


@pytest.mark.parametrize("values", [np.array([[0.5]], np.float32), np.array([[70000]], np.int32)])
def test_a_texture_without_a_known_white_is_refused(tmp_path, values):
    Image.fromarray(values).save(tmp_path / "t.tif")
    with pytest.raises(DataError, match=r"t\.tif is of a kind.*8 or 16 bits a channel; got mode"):
        load_rgb(tmp_path / "t.tif")


def test_masks_of_truth_values_become_black_and_white(tmp_path):
    save_png(tmp_path / "m.png", np.array([[True, False]]))
    assert np.asarray(Image.open(tmp_path / "m.png")).tolist() == [[255, 0]]


@pytest.mark.parametrize(
    "image", [np.zeros((4, 4)), np.zeros((4, 4, 2), np.uint8), np.zeros((0, 4), np.uint8)]
)
def test_what_is_not_an_image_is_not_written(tmp_path, image):
    with pytest.raises(DataError, match="cannot write"):
        save_png(tmp_path / "a.png", image)
    assert not list(tmp_path.iterdir())


def test_composite_blends_by_alpha():
    rgba = np.array([[[255, 0, 0, 255], [255, 0, 0, 51], [9, 9, 9, 0]]], dtype=np.uint8)
    over = composite(rgba, (0.0, 0.0, 1.0))
    assert over[0] == pytest.approx(np.array([[1, 0, 0], [0.2, 0, 0.8], [0, 0, 1]]))


def test_srgb_and_linear_are_inverse_and_meet_known_values():
    values = np.linspace(0, 1, 101)
    assert srgb_from_linear(linear_from_srgb(values)) == pytest.approx(values, abs=1e-12)
    assert linear_from_srgb(0.5) == pytest.approx(0.21404, abs=1e-5)
    assert srgb_from_linear(0.18) == pytest.approx(0.46136, abs=1e-5)


def test_a_smaller_image_has_the_means_of_what_its_pixels_cover():
    image = np.arange(48, dtype=float).reshape(4, 6, 2)
    small = resampled(image, (3, 2), "box")
    np.testing.assert_allclose(small, image.reshape(2, 2, 3, 2, 2).mean(axis=(1, 3)))
    np.testing.assert_array_equal(resampled(image[..., 1], (3, 2), "box"), small[..., 1])
    even = np.full((8, 8), 0.25)
    np.testing.assert_allclose(resampled(even, (3, 3), "bilinear"), 0.25)
