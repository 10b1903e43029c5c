"""Where a training photo is taken from: heights, distances and directions as people choose them.

Most photos are taken at the height of the body, half of them from near the front or the back, which
is what methods estimate. A third look down or up, and some are taken from as near as a wide lens
asks for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera, look_at
from harness.geometry.window import Window

_NEAR_AXIS = 0.5
_YAW_DEG, _PITCH_DEG, _ROLL_DEG = 15.0, 6.0, 2.0
_STEEP = 0.3
_STEEP_DEG = (-20.0, 30.0)
#: A full figure on a frame of 36 mm: from a lens of 29 mm to one of 90 mm.
_DISTANCE_M = (1.6, 5.0)
#: Share of the square that the subject's longer side fills; methods crop at 0.9.
_FILLED = (0.82, 0.95)
#: Pixels of the square before it is brought to its size: whole pixels are then fine enough.
_FINE_PX = 4000
#: What has to be within the square: half the subject's height, and how far it reaches towards the
#: camera.
_HALF_HEIGHT_M, _REACH_M = 1.25, 0.35


@dataclass(frozen=True, slots=True)
class PhotoSize:
    """How large a training photo is, and the subject in it.

    Attributes:
        side_px: Side of the square that the subject fills, as methods crop it.
        width_px, height_px: Size of the window within the square that is kept.
    """

    side_px: int
    width_px: int
    height_px: int


def drawn_camera(vertices: Floats, size: PhotoSize, draw: np.random.Generator) -> Camera:
    """A camera that looks at the subject, cropped as methods crop, a little off at random.

    Args:
        vertices: (V, 3) of the subject, world metres, its box centred at the origin.
        size: How large the photo is, and the subject in it.
        draw: Source of randomness.
    """
    if draw.random() < _NEAR_AXIS:
        yaw = draw.choice([0.0, 180.0]) + draw.normal(0.0, _YAW_DEG)
    else:
        yaw = draw.uniform(0.0, 360.0)
    steep = draw.random() < _STEEP
    pitch = draw.uniform(*_STEEP_DEG) if steep else draw.normal(0.0, _PITCH_DEG)
    yaw, pitch = math.radians(yaw), math.radians(pitch)
    direction = np.array(
        [math.cos(pitch) * math.sin(yaw), math.sin(pitch), math.cos(pitch) * math.cos(yaw)]
    )
    roll = math.radians(draw.normal(0.0, _ROLL_DEG))
    up = (math.sin(roll) * math.cos(yaw), math.cos(roll), -math.sin(roll) * math.sin(yaw))
    distance = math.exp(draw.uniform(*np.log(_DISTANCE_M)))
    focal = min(_FINE_PX, _FINE_PX / 2 * (distance - _REACH_M) / _HALF_HEIGHT_M)
    K = np.diag([focal, focal, 1.0])
    K[:2, 2] = _FINE_PX / 2
    whole = Camera(K, look_at(distance * direction, np.zeros(3), up), _FINE_PX, _FINE_PX)
    return _cropped(whole, vertices, size, draw)


def _cropped(whole: Camera, vertices: Floats, size: PhotoSize, draw: np.random.Generator) -> Camera:
    box = Window.around_points(vertices, whole, margin=0)
    side_px, width, height = size.side_px, size.width_px, size.height_px
    side = int(box.longer_side / draw.uniform(*_FILLED))
    shift = draw.uniform(-0.02, 0.02, 2) * side
    left, top = (
        round(low + (extent - side * share) / 2 + off)
        for low, extent, share, off in (
            (box.left, box.width, width / side_px, shift[0]),
            (box.top, box.height, height / side_px, shift[1]),
        )
    )
    window = Window(left, top, round(side * width / side_px), round(side * height / side_px))
    return window.camera(whole, (width, height))
