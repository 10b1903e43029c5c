"""How a training photo is taken: a camera somewhere around the subject, and lamps around it.

The light is even light from everywhere, with contact shadows, and one or two soft lamps that cast
shadows; colours, strengths, exposure and the sensor's noise vary from photo to photo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera, look_at
from harness.geometry.images import srgb_from_linear
from harness.geometry.window import Window

__all__ = ["Lamp", "Light", "PhotoSize", "drawn_camera", "drawn_light", "photographed"]


#: Half of the views are near the front and the back, which is what methods estimate.
_NEAR_AXIS = 0.5
_YAW_DEG, _PITCH_DEG, _ROLL_DEG = 15.0, 6.0, 2.0
_DISTANCE_M = (2.2, 5.0)
#: Share of the square that the subject's longer side fills; methods crop at 0.9.
_FILLED = (0.82, 0.95)
#: Pixels of the square before it is brought to its size: whole pixels are then fine enough.
_FINE_FOCAL_PX = 4000.0
_LAMP_POINTS = 6


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


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """A soft lamp: (L, 3) points in world metres, and its linear colour (3,)."""

    points: Floats
    colour: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """All light of one photo, and how it becomes a picture.

    Attributes:
        even: (3,) linear colour of the light from everywhere.
        lamps: One or two.
        exposure: Factor on all light.
        contrast: Exponent on the colours of the picture.
        noise: Standard deviation of the sensor's noise, as sRGB in [0, 1].
    """

    even: Floats
    lamps: tuple[Lamp, ...]
    exposure: float
    contrast: float
    noise: float


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
    yaw, pitch = math.radians(yaw), math.radians(draw.normal(0.0, _PITCH_DEG))
    direction = np.array(
        [math.cos(pitch) * math.sin(yaw), math.sin(pitch), math.cos(pitch) * math.cos(yaw)]
    )
    roll = math.radians(draw.normal(0.0, _ROLL_DEG))
    up = (math.sin(roll) * math.cos(yaw), math.cos(roll), -math.sin(roll) * math.sin(yaw))
    extrinsic = look_at(draw.uniform(*_DISTANCE_M) * direction, np.zeros(3), up)
    K = np.diag([_FINE_FOCAL_PX, _FINE_FOCAL_PX, 1.0])
    K[:2, 2] = _FINE_FOCAL_PX / 2
    whole = Camera(K, extrinsic, int(_FINE_FOCAL_PX), int(_FINE_FOCAL_PX))
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


def drawn_light(camera: Camera, draw: np.random.Generator) -> Light:
    """Light around the subject of a camera; most of it from the camera's side and from above."""
    even = draw.uniform(0.25, 0.9)
    lamps = tuple(_drawn_lamp(camera, draw) for _ in range(draw.choice([1, 1, 2])))
    return Light(
        even=even * _tint(draw),
        lamps=lamps,
        exposure=float(np.exp(draw.normal(0.0, 0.2))),
        contrast=float(np.exp(draw.normal(0.0, 0.12))),
        noise=float(draw.uniform(0.0, 0.015)),
    )


def _drawn_lamp(camera: Camera, draw: np.random.Generator) -> Lamp:
    distance = draw.uniform(1.5, 4.0)
    across, height = draw.uniform(-80, 80), draw.uniform(-15, 75)
    turn, lift = math.radians(across), math.radians(height)
    # Camera axes: x right, y down, z forward; the lamp is seen from the subject.
    toward = np.array(
        [math.cos(lift) * math.sin(turn), -math.sin(lift), -math.cos(lift) * math.cos(turn)]
    )
    centre = distance * toward @ camera.rotation
    radius = draw.uniform(0.1, 0.9)
    points = centre + radius * draw.uniform(-1, 1, (_LAMP_POINTS, 3))
    return Lamp(points, draw.uniform(0.15, 0.75) * _tint(draw))


def _tint(draw: np.random.Generator) -> Floats:
    return np.exp(draw.normal(0.0, 0.06, 3))


def photographed(linear: Floats, light: Light, draw: np.random.Generator) -> Floats:
    """Colours in [0, 1], sRGB, of linear light (..., 3): exposed, clipped, with sensor noise."""
    picture = srgb_from_linear(np.clip(light.exposure * linear, 0.0, 1.0)) ** light.contrast
    return np.clip(picture + light.noise * draw.normal(size=picture.shape), 0.0, 1.0)
