"""Rotations averaged where they live, on SO(3)."""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Floats


def mean_rotation(rotations: Floats) -> Floats:
    """(3, 3) chordal mean of rotations (N, 3, 3): the one with the least sum of squared distances.

    Source: Hartley et al., Rotation averaging, IJCV 2013. Exact, and the same in whatever order.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotations).mean().as_matrix()


def mean_of_columns(rotations: Floats) -> Floats:
    """(3, 3) rotation of the mean first two columns of rotations (N, 3, 3), made perpendicular.

    MExECON averages so, in the six numbers that PIXIE answers with. Eight rotations that scatter by
    20 degrees have means 0.6 degrees apart by this and by ``mean_rotation``.
    """
    first, second = rotations[:, :, 0].mean(0), rotations[:, :, 1].mean(0)
    x = first / np.linalg.norm(first)
    y = second - (x @ second) * x
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def mean_rotation_vector(vectors: Floats) -> Floats:
    """(3,) rotation vector of the chordal mean of rotation vectors (N, 3), radians."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vectors).mean().as_rotvec()


def upright(left_world: Floats) -> Floats:
    """(3, 3) rotation of an upright body whose left hand points as ``left_world`` (3,) does.

    Its columns are the body's left, up and forward in world axes; a vector that is vertical or 0
    says nothing and gives the body that faces +Z.
    """
    left = np.array([left_world[0], 0.0, left_world[2]])
    length = np.linalg.norm(left)
    left = np.array([1.0, 0.0, 0.0]) if length < 1e-9 else left / length
    up = np.array([0.0, 1.0, 0.0])
    return np.stack([left, up, np.cross(left, up)], axis=1)
