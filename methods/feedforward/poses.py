"""Cameras as VGGT encodes them: a shift, a quaternion and two fields of view."""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera
from harness.core.errors import MethodError

#: The network's unprojection counts pixels by whole numbers and has the principal point at half the
#: picture; here the centre of the first pixel is at 0.5, so that the point moves by as much.
_HALF_PIXEL = 0.5


def decoded_cameras(encoded: Floats, size: tuple[int, int]) -> tuple[Camera, ...]:
    """The cameras behind pose encodings (S, 9), in the network's own world and unit.

    An encoding is the shift (3) and the quaternion x, y, z, w of world-to-camera in OpenCV's axes,
    then the vertical and the horizontal field of view, radians.

    Args:
        encoded: (S, 9).
        size: Width and height of the network's pictures.

    Raises:
        MethodError: encodings that are not finite, or without a rotation or a field of view.
    """
    width, height = size
    encoded = np.asarray(encoded, dtype=np.float64)
    length = np.linalg.norm(encoded[:, 3:7], axis=1)
    fields = encoded[:, 7:9]
    good = np.isfinite(encoded).all(axis=1) & (length > 0)
    good &= ((fields > 0) & (fields < np.pi)).all(axis=1)
    if not good.all():
        view = int(np.argmin(good))
        raise MethodError(
            f"the network found no camera for photo {view + 1} of {len(encoded)}",
            expected="a rotation, and fields of view between 0 and 180 degrees",
            got=np.array2string(encoded[view], precision=3),
        )
    cameras: list[Camera] = []
    for row, norm in zip(encoded, length, strict=True):
        move = np.eye(4)
        move[:3, :3] = _rotation(row[3:7] / norm)
        move[:3, 3] = row[:3]
        fy, fx = height / 2.0 / np.tan(row[7] / 2.0), width / 2.0 / np.tan(row[8] / 2.0)
        cx, cy = width / 2.0 + _HALF_PIXEL, height / 2.0 + _HALF_PIXEL
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        cameras.append(Camera(K, move, width, height))
    return tuple(cameras)


def _rotation(quaternion: Floats) -> Floats:
    """(3, 3) of a unit quaternion x, y, z, w."""
    x, y, z, w = quaternion
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
