"""Rotations and Blender's cameras survive the trip there and back, and Blender's axes hold."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from harness.core.camera import Camera
from harness.core.camera_frames import (
    BLENDER_TO_WORLD,
    OPENCV_TO_BLENDER_CAMERA,
    camera_to_blender,
    quaternion_from_rotation,
    rotation_from_quaternion,
)

_unit = st.floats(-1, 1, allow_nan=False)
quaternions = st.tuples(_unit, _unit, _unit, _unit).filter(lambda q: np.linalg.norm(q) > 0.05)


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = rotation_from_quaternion(draw(quaternions))
    world_to_camera[:3, 3] = draw(st.tuples(*[st.floats(-9, 9)] * 3))
    fx, fy, cx, cy = draw(st.tuples(*[st.floats(10, 5000)] * 4))
    width, height = draw(st.tuples(st.integers(1, 5000), st.integers(1, 5000)))
    return Camera(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), world_to_camera, width, height)


@given(quaternions)
def test_rotation_of_a_quaternion_and_back(quaternion: tuple[float, ...]) -> None:
    rotation = rotation_from_quaternion(quaternion)
    back = quaternion_from_rotation(rotation)

    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) > 0
    assert back[0] >= 0
    # q and -q are one rotation.
    unit = np.array(quaternion) / np.linalg.norm(quaternion)
    assert abs(unit @ back) > 1 - 1e-9
    np.testing.assert_allclose(rotation_from_quaternion(back), rotation, atol=1e-9)


@given(cameras())
def test_blender_there_and_back(camera: Camera) -> None:
    matrix_world = camera_to_blender(camera)

    back = BLENDER_TO_WORLD @ matrix_world @ OPENCV_TO_BLENDER_CAMERA
    np.testing.assert_allclose(back, camera.camera_to_world, atol=1e-9)
    # Blender looks along its own -Z.
    forward_world = BLENDER_TO_WORLD[:3, :3] @ -matrix_world[:3, 2]
    np.testing.assert_allclose(forward_world, camera.forward, atol=1e-9)
