"""Texture colours at rays' hits: a square with a two-by-two picture on it."""

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from harness.core.mesh import Mesh
from harness.geometry.photo import linear_texture, texture_at
from harness.geometry.raycast import Raycaster

SQUARE = Mesh(
    vertices=np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float),
    faces=np.array([[0, 1, 2], [0, 2, 3]]),
    uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float),
    face_uv=np.array([[0, 1, 2], [0, 2, 3]]),
)


def seen(texture, size=80):
    K = np.array([[size, 0, size / 2], [0, size, size / 2], [0, 0, 1.0]])
    camera = Camera(K, look_at((0, 0, 4.0), (0, 0, 0)), size, size)
    hits = Raycaster(SQUARE).cast(camera)
    return hits, texture_at(hits, SQUARE, texture)


def test_the_first_row_of_the_texture_is_on_top():
    texture = np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]], float)
    hits, colour = seen(texture)
    # Texel centres are a quarter in from the square's sides: pixel 30 of 80 and pixel 50.
    for row, column, wanted in ((30, 30, (1, 0, 0)), (30, 50, (0, 1, 0)), (50, 30, (0, 0, 1))):
        np.testing.assert_allclose(colour[row, column], wanted, atol=0.06)
    assert not colour[~hits.mask].any()


def test_a_ramp_is_blended():
    ramp = np.linspace(0, 1, 64)[None, :, None] * np.ones((64, 1, 3))
    hits, colour = seen(ramp)
    row = colour[40, hits.mask[40], 0]
    assert (np.diff(row)[2:-2] > 0).all()
    assert row[len(row) // 2] == pytest.approx(0.5, abs=0.02)


def test_linear_intensities_of_bytes():
    np.testing.assert_allclose(
        linear_texture(np.array([[[0, 188, 255]]], np.uint8))[0, 0], [0, 0.503, 1], atol=1e-3
    )
