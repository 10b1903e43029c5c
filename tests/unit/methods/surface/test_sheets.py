"""Sheets in closed form: where their vertices lie, which way they face, what is dropped."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from harness.core.errors import DataError
from methods.surface import SheetParameters, front_back_sheets
from methods.surface.fusion import in_large_piece


def square_camera(K: np.ndarray, size: int) -> Camera:
    return Camera(K, look_at((0.3, 0.4, 3.0), (0.0, 0.0, 0.0)), size, size)


@pytest.fixture
def flat(camera_matrix):
    size = 40
    camera = square_camera(camera_matrix(size, 2.0), size)
    return camera, np.full((size, size), 2.5), np.full((size, size), 3.5)


def test_vertices_are_the_pixel_centres_at_their_depth(flat) -> None:
    camera, front, back = flat
    for sheet, depth in zip(front_back_sheets(front, back, camera), (2.5, 3.5), strict=True):
        pixels, distance = camera.project(sheet.vertices)
        np.testing.assert_allclose(pixels, camera.pixel_centres().reshape(-1, 2), atol=1e-9)
        np.testing.assert_allclose(distance, depth)
        assert len(sheet.faces) == 2 * 39 * 39


def test_front_faces_the_camera_and_back_faces_away(flat) -> None:
    camera, front, back = flat
    near, far = front_back_sheets(front, back, camera)
    assert (near.face_normals() @ camera.forward < 0).all()
    assert (far.face_normals() @ camera.forward > 0).all()


def test_both_sheets_of_an_ellipsoid_enclose_most_of_its_volume(camera_matrix, ellipsoid) -> None:
    size, radii = 300, (0.5, 0.62, 0.3)
    K = camera_matrix(size, 2.0)
    near, far = ellipsoid(size, (0.0, 0.05, 3.0), radii, K)
    camera = square_camera(K, size)
    sheets = front_back_sheets(near.depth, far.depth, camera, SheetParameters(least_facing=0.0))
    centre = camera.unproject(np.array([[K[0, 2], K[1, 2]]]), np.array([3.0]))[0]
    parts = []
    for sheet in sheets:
        a, b, c = (sheet.vertices[sheet.faces[:, corner]] - centre for corner in range(3))
        parts.append(float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0)
    # Less the wedge between the two open rims.
    whole = 4 / 3 * np.pi * np.prod(radii)
    assert 0.85 * whole < sum(parts) < whole
    assert min(parts) > 0.35 * whole


def test_stretched_faces_are_dropped(flat) -> None:
    camera, front, back = flat
    front = front.copy()
    front[:, 20:] -= 0.5
    near, _ = front_back_sheets(front, back, camera)
    _, depth = camera.project(near.vertices)
    spans = np.ptp(depth[near.faces], axis=1)
    assert spans.max() < 1e-9
    assert len(near.faces) == 2 * 39 * (39 - 1)


def test_facing_is_measured_along_the_line_of_sight(camera_matrix) -> None:
    """A plane seen at 10 degrees goes, at 14 stays: cos of the limit 0.2 is 11.5 degrees."""
    size = 60
    K = camera_matrix(size, 40.0)  # so long a lens that all rays are nearly parallel
    camera = square_camera(K, size)
    y = camera.pixel_centres()[..., 1] - K[1, 2]

    def faces_left(degrees: float) -> int:
        tilted = 3.0 + y / K[1, 1] * 3.0 / np.tan(np.radians(degrees))
        near, _ = front_back_sheets(tilted, tilted + 1.0, camera)
        return len(near.faces)

    assert faces_left(14.0) == 2 * 59 * 59
    with pytest.raises(DataError, match="front sheet has no triangle left"):
        faces_left(10.0)


def test_small_components_are_dropped(flat) -> None:
    camera, front, back = flat
    front = front.copy()
    front[:, 30] = np.nan
    front[5:, 31:] = np.nan  # 5 x 9 pixels of 1245 stay apart: 3.6 %
    near, _ = front_back_sheets(front, back, camera)
    assert len(near.vertices) == 40 * 30 + 45
    near, _ = front_back_sheets(front, back, camera, SheetParameters(least_component=0.05))
    assert len(near.vertices) == 40 * 30


def test_a_component_of_exactly_the_share_goes() -> None:
    big = np.array([[0, i, i + 1] for i in range(1, 8)])  # 9 vertices
    one = np.array([[20, 21, 22]])  # 3 of 12
    faces = np.concatenate([big, one])
    assert in_large_piece(faces, 0.25).sum() == len(big)
    assert in_large_piece(faces, 0.24).sum() == len(faces)


def test_a_map_of_another_size_is_said(flat) -> None:
    camera, front, back = flat
    with pytest.raises(DataError, match="front sheet and camera do not match"):
        front_back_sheets(front[1:], back, camera)
    with pytest.raises(DataError, match="back sheet has no triangle left"):
        front_back_sheets(front, np.full_like(back, np.nan), camera)
