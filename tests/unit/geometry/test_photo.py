"""Photos and their cameras: what is cropped together stays together, and files decode once."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, image_name
from harness.core.errors import DataError
from harness.core.rigs import RingRig
from harness.geometry import images
from harness.geometry.images import composite, save_png
from harness.geometry.photo import BLACK, WHITE, open_photo
from harness.geometry.window import Window

WIDTH, HEIGHT = 54, 96


@pytest.fixture
def capture(tmp_path: Path) -> Capture:
    """Twelve views of a red disc with a soft rim, none like another."""
    cameras = RingRig(views=12).cameras(WIDTH, HEIGHT)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    for view in range(len(cameras)):
        radius = np.hypot(rows - 50, columns - 20 - view)
        rgba = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
        rgba[..., 0] = 200 + view
        rgba[..., 3] = np.round(255 * np.clip(15.5 - radius, 0, 1))
        save_png(tmp_path / image_name(view), rgba)
    return Capture("toy", "disc", "twelve", "key", tmp_path, cameras)


@pytest.fixture
def decoded(monkeypatch) -> list[Path]:
    """The files that were decoded, in order."""
    files: list[Path] = []
    decode = images._decoded
    monkeypatch.setattr(images, "_decoded", lambda path: files.append(path) or decode(path))
    return files


def test_every_file_is_decoded_once_however_often_it_is_opened(capture, decoded):
    for _ in range(3):
        for view in range(12):
            photo = open_photo(capture, view)
            assert photo.rgba[50, 20 + view, 0] == 200 + view
            assert photo.outline.box == Window.around(photo.mask)
    assert decoded == [capture.image_path(view) for view in range(12)]


def test_a_file_that_was_written_anew_is_read_anew(capture, decoded):
    before = open_photo(capture, 0)
    path = capture.image_path(0)
    save_png(path, np.ascontiguousarray(before.rgba[:, ::-1]))
    os.utime(path, ns=(1, 1))
    np.testing.assert_array_equal(open_photo(capture, 0).rgba, before.rgba[:, ::-1])
    assert len(decoded) == 2


def test_memory_is_bounded_and_the_last_used_stay(capture, decoded, monkeypatch):
    monkeypatch.setattr(images, "_photos", images._Kept())
    monkeypatch.setattr(images, "_KEPT_BYTES", 3 * WIDTH * HEIGHT * 4)
    for view in (0, 1, 2, 0, 3, 0, 2, 1):
        open_photo(capture, view)
    assert [int(path.stem) for path in decoded] == [0, 1, 2, 3, 1]


def test_shared_pixels_cannot_be_written_to(capture):
    with pytest.raises(ValueError, match="read-only"):
        open_photo(capture, 0).rgba[0, 0] = 1


def test_colours_coverage_and_camera_are_cropped_together(capture):
    photo = open_photo(capture, 2)
    window = Window(-4, 30, 40, 90)
    part = photo.cropped(window)
    assert part.camera.size == part.rgba.shape[1::-1] == (40, 90)
    inside = (slice(0, HEIGHT - 30), slice(4, 40))
    for whole, cut in (
        (photo.rgba, part.rgba), (photo.mask, part.mask), (photo.coverage, part.coverage),
        (photo.over(), part.over()),
    ):  # fmt: skip
        np.testing.assert_array_equal(cut[inside], whole[30:, :36])
    assert not part.rgba[HEIGHT - 30 :].any()
    assert (part.over(WHITE)[HEIGHT - 30 :] == 1.0).all()
    point = photo.camera.unproject([(22.5, 50.5)], [3.0])
    np.testing.assert_allclose(part.camera.project(point)[0], [[26.5, 20.5]], atol=1e-9)


def test_a_picture_of_half_the_size_keeps_the_subject_under_its_camera(capture):
    photo = open_photo(capture, 1)
    picture = photo.resized(WIDTH // 2, HEIGHT // 2)
    assert picture.camera.size == picture.mask.shape[::-1] == (27, 48)
    rows, columns = np.nonzero(picture.mask)
    centre = np.array([columns.mean(), rows.mean()]) + 0.5
    np.testing.assert_allclose(centre, np.array([21.0, 50.0]) / 2, atol=0.1)
    np.testing.assert_allclose(picture.rgb[25, 10], [201 / 255, 0.0, 0.0], atol=1e-6)
    # Over black a half-covered pixel is as dark as it is covered.
    np.testing.assert_allclose(picture.rgb[..., 0], 201 / 255 * picture.coverage, atol=1e-6)


def test_a_photo_of_another_size_than_its_camera_is_refused(capture):
    save_png(capture.image_path(3), np.zeros((HEIGHT, WIDTH + 1, 4), np.uint8))
    with pytest.raises(DataError, match="another size than its camera"):
        open_photo(capture, 3)
    capture.image_path(4).unlink()
    with pytest.raises(DataError, match="no image at"):
        open_photo(capture, 4)


@pytest.mark.parametrize("ground", [BLACK, WHITE, (0.2, 0.3, 0.7)])
def test_a_photo_over_a_colour_is_blended_to_the_bit(capture, ground):
    photo = open_photo(capture, 0)
    assert ((photo.rgba[..., 3] > 0) & (photo.rgba[..., 3] < 255)).sum() > 0
    np.testing.assert_array_equal(photo.over(ground), composite(photo.rgba, ground))
