"""Laws of the camera that hold for every camera and every point."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from harness.core.camera import Camera, look_at, rigid_inverse
from harness.core.camera_frames import rotation_from_quaternion


def _numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


@st.composite
def rotations(draw: st.DrawFn) -> np.ndarray:
    quaternion = draw(st.tuples(*[_numbers(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.05))
    return rotation_from_quaternion(quaternion)


@st.composite
def rigid_transforms(draw: st.DrawFn) -> np.ndarray:
    transform = np.eye(4)
    transform[:3, :3] = draw(rotations())
    transform[:3, 3] = draw(st.tuples(*[_numbers(-10, 10)] * 3))
    return transform


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    width, height = draw(st.integers(1, 4000)), draw(st.integers(1, 4000))
    fx, fy = draw(_numbers(50, 5000)), draw(_numbers(50, 5000))
    cx, cy = draw(_numbers(-100, 4100)), draw(_numbers(-100, 4100))
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return Camera(K, draw(rigid_transforms()), width, height)


#: Points in front of a camera: pixel x, pixel y, depth in metres.
sights = st.lists(
    st.tuples(_numbers(-500, 4500), _numbers(-500, 4500), _numbers(0.1, 20)),
    min_size=1,
    max_size=8,
).map(np.array)


@given(cameras(), sights)
def test_project_undoes_unproject(camera: Camera, sight: np.ndarray) -> None:
    pixels, depth = camera.project(camera.unproject(sight[:, :2], sight[:, 2]))

    np.testing.assert_allclose(pixels, sight[:, :2], atol=1e-6)
    np.testing.assert_allclose(depth, sight[:, 2], rtol=1e-9)


@given(cameras(), sights)
def test_a_ray_of_a_pixel_times_its_depth_reaches_the_point(
    camera: Camera, sight: np.ndarray
) -> None:
    reached = camera.position + camera.ray_directions(sight[:, :2]) * sight[:, 2:]

    np.testing.assert_allclose(reached, camera.unproject(sight[:, :2], sight[:, 2]), atol=1e-8)


@given(cameras(), sights, st.integers(1, 3000), st.integers(1, 3000))
def test_resizing_scales_pixels_and_keeps_the_field_of_view(
    camera: Camera, sight: np.ndarray, width: int, height: int
) -> None:
    points = camera.unproject(sight[:, :2], sight[:, 2])
    small = camera.resized(width, height)

    expected = sight[:, :2] * [width / camera.width, height / camera.height]
    np.testing.assert_allclose(small.project(points)[0], expected, atol=1e-5)
    assert (small.width, small.height) == (width, height)


@given(cameras(), st.integers(1, 3000), st.integers(1, 3000))
def test_resizing_there_and_back_is_the_same_camera(camera: Camera, w: int, h: int) -> None:
    back = camera.resized(w, h).resized(camera.width, camera.height)

    np.testing.assert_allclose(back.K, camera.K, rtol=1e-12)


@given(cameras(), sights, st.integers(-300, 300), st.integers(-300, 300))
def test_cropping_shifts_pixels(camera: Camera, sight: np.ndarray, left: int, top: int) -> None:
    points = camera.unproject(sight[:, :2], sight[:, 2])
    window = camera.cropped(left, top, 64, 48)

    np.testing.assert_allclose(window.project(points)[0], sight[:, :2] - [left, top], atol=1e-6)
    assert (window.width, window.height) == (64, 48)


@given(cameras(), sights, rotations())
def test_turning_keeps_the_centre_and_moves_pixels_by_a_homography(
    camera: Camera, sight: np.ndarray, rotation: np.ndarray
) -> None:
    turned = camera.turned(rotation)
    homography = camera.K @ rotation @ np.linalg.inv(camera.K)
    homogeneous = np.c_[sight[:, :2], np.ones(len(sight))] @ homography.T
    in_front = homogeneous[:, 2] > 1e-2

    pixels, depth = turned.project(camera.unproject(sight[:, :2], sight[:, 2]))

    np.testing.assert_allclose(turned.position, camera.position, atol=1e-8)
    np.testing.assert_allclose(depth, homogeneous[:, 2] * sight[:, 2], atol=1e-8)
    expected = homogeneous[in_front, :2] / homogeneous[in_front, 2:]
    np.testing.assert_allclose(pixels[in_front], expected, rtol=1e-7, atol=1e-4)


@given(cameras(), sights, rigid_transforms())
def test_another_world_frame_sees_the_same_picture(
    camera: Camera, sight: np.ndarray, world_to_other: np.ndarray
) -> None:
    points = camera.unproject(sight[:, :2], sight[:, 2])
    moved = points @ world_to_other[:3, :3].T + world_to_other[:3, 3]

    pixels, depth = camera.in_frame(world_to_other).project(moved)

    np.testing.assert_allclose(depth, sight[:, 2], atol=1e-8)
    np.testing.assert_allclose(pixels, sight[:, :2], atol=1e-4)


@given(rigid_transforms())
def test_rigid_inverse_is_the_inverse(transform: np.ndarray) -> None:
    np.testing.assert_allclose(rigid_inverse(transform) @ transform, np.eye(4), atol=1e-12)


@given(cameras())
def test_plain_values_lose_nothing(camera: Camera) -> None:
    copy = Camera.from_dict(camera.to_dict())

    assert copy.to_dict() == camera.to_dict()


@given(st.tuples(*[_numbers(-5, 5)] * 3).filter(lambda p: np.hypot(p[0], p[2]) > 0.1))
def test_look_at_centres_its_target_and_keeps_up_upright(position: tuple[float, ...]) -> None:
    camera = Camera(np.diag([100.0, 100.0, 1.0]), look_at(position, (0, 0, 0)), 10, 10)

    pixels, depth = camera.project(np.array([[0.0, 0, 0], [0, 0.01, 0]]))

    np.testing.assert_allclose(camera.position, position, atol=1e-12)
    np.testing.assert_allclose(pixels[0], 0, atol=1e-9)
    np.testing.assert_allclose(depth[0], np.linalg.norm(position))
    assert abs(pixels[1, 0]) < 1e-9
    assert pixels[1, 1] < 0, "what is higher in the world is higher in the picture"
