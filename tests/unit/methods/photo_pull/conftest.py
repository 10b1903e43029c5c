"""The sphere that stereo's tests photograph, and what shifts of photos leave open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from tests.unit.methods.stereo.conftest import sphere, textured

_STEP_M = 1e-5


def without_common_move(shifts: Floats, points: Floats, cameras: Sequence[Camera]) -> Floats:
    """(C, 2) what is left of shifts of photos that no move of the points (N, 3) explains."""
    columns = [
        np.concatenate(
            [
                (c.project(points + _STEP_M * axis)[0] - c.project(points)[0]).mean(axis=0)
                for c in cameras
            ]
        )
        / _STEP_M
        for axis in np.eye(3)
    ]
    moves = np.stack(columns, axis=1)
    common = np.linalg.lstsq(moves, shifts.ravel(), rcond=None)[0]
    return shifts - (moves @ common).reshape(-1, 2)
