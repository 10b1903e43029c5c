"""The camera by example: its half pixel, its refusals, its immutability."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from harness.core.errors import DataError

K = np.array([[100.0, 0, 32], [0, 100, 24], [0, 0, 1]])


def camera(**changes: object) -> Camera:
    values = {"K": K, "world_to_camera": np.eye(4), "width": 64, "height": 48, **changes}
    return Camera(**values)  # type: ignore[arg-type]


def changed(matrix: np.ndarray, row: int, column: int, value: float) -> np.ndarray:
    copy = matrix.copy()
    copy[row, column] = value
    return copy


def test_the_centre_of_the_first_pixel_is_half() -> None:
    centres = camera().pixel_centres()

    assert centres.shape == (48, 64, 2)
    assert centres[0, 0].tolist() == [0.5, 0.5]
    assert centres[47, 63].tolist() == [63.5, 47.5]


def test_a_known_point_lands_on_a_known_pixel() -> None:
    pixels, depth = camera().project([[0.1, -0.2, 2.0]])

    np.testing.assert_allclose(pixels, [[32 + 5, 24 - 10]])
    assert depth.tolist() == [2.0]


def test_a_shifted_photo_shows_everything_further_on() -> None:
    shifted = camera().shifted(1.5, -2.0)
    pixels, _ = shifted.project([[0.1, -0.2, 2.0]])

    np.testing.assert_allclose(pixels, [[37 + 1.5, 14 - 2.0]])
    assert shifted.size == camera().size


def test_a_point_behind_the_camera_has_a_depth_but_no_pixel() -> None:
    pixels, depth = camera().project([[0, 0, -1.0], [0, 0, 0.0], [0, 0, 1.0]])

    assert np.isnan(pixels).all(axis=1).tolist() == [True, True, False]
    assert depth.tolist() == [-1, 0, 1]


def test_no_points_are_projected_to_no_pixels() -> None:
    pixels, depth = camera().project(np.zeros((0, 3)))

    assert pixels.shape == (0, 2)
    assert depth.shape == (0,)


def test_nothing_about_a_camera_can_be_changed() -> None:
    mine = K.copy()
    made = camera(K=mine)
    mine[0, 0] = 5

    assert made.K[0, 0] == 100, "the camera keeps its own copy"
    for array in (made.K, made.world_to_camera, made.rotation):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.width = 3  # type: ignore[misc]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"K": np.eye(4)}, "camera K is not usable .*shape \\(4, 4\\)"),
        ({"K": changed(K, 0, 0, np.nan)}, "camera K is not usable"),
        ({"world_to_camera": np.eye(4)[:3]}, "camera world_to_camera is not usable"),
        ({"K": changed(K, 0, 0, 0)}, "not an intrinsic matrix"),
        ({"K": changed(K, 1, 1, -100)}, "not an intrinsic matrix"),
        ({"K": changed(K, 0, 1, 0.5)}, "not an intrinsic matrix"),
        ({"K": changed(K, 2, 2, 2)}, "not an intrinsic matrix"),
        ({"width": 0}, "camera has no pixels"),
        ({"height": -3}, "camera has no pixels"),
        ({"world_to_camera": np.diag([1.0, 1, -1, 1])}, "not rigid .*determinant -1"),
        ({"world_to_camera": np.diag([2.0, 2, 2, 1])}, "not rigid"),
    ],
)
def test_what_is_no_pinhole_camera_is_refused(changes: dict, message: str) -> None:
    with pytest.raises(DataError, match=message):
        camera(**changes)


@pytest.mark.parametrize(
    "value",
    [
        {},
        {"K": K.tolist()},
        {**camera().to_dict(), "width": "wide"},
        {**camera().to_dict(), "K": 3},
    ],
)
def test_what_is_not_a_camera_is_not_read_as_one(value: dict) -> None:
    with pytest.raises(DataError):
        Camera.from_dict(value)


@pytest.mark.parametrize("position", [(0, 2, 0), (0, 0, 0)])
def test_looking_along_up_or_nowhere_has_no_answer(position: tuple) -> None:
    with pytest.raises(DataError, match="no unique answer"):
        look_at(position, (0, 0, 0))
