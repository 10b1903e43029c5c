"""In which light a training photo is taken, how surfaces shine in it, and how it is exposed.

The light is that of a sky and of a ground, with contact shadows, and up to three lamps that cast
shadows, from one as wide as a window to one as hard as the sun; colours, strengths, gloss, exposure
and the sensor's noise vary from photo to photo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Bytes, Floats
from harness.core.camera import Camera
from harness.geometry.images import srgb_from_linear

LAMPS = 2
"""Number of lamps whose light is stored with a photo."""

_LAMP_POINTS = 6
_LAMPS = (0, 1, 1, 1, 2, 2, 3)
_RADIUS_M = (0.03, 0.9)
#: Deviation of the logarithm of each colour of a lamp or of the sky.
_TINT = 0.1
#: A ground gives back some of the sky's light, in its own colour.
_GROUND = (0.2, 1.0)
_MATT = 0.6
_GLOSS, _SHARPNESS = (0.02, 0.18), (4.0, 60.0)


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """A soft lamp: (L, 3) points in world metres, and its linear colour (3,)."""

    points: Floats
    colour: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """All light of one photo, and how it becomes a picture.

    Attributes:
        sky: (3,) linear colour of the light from above; half of the light on upright surfaces.
        ground: (3,) the same of the light from below.
        lamps: At most three.
        exposure: Factor on all light.
        contrast: Exponent on the colours of the picture.
        noise: Standard deviation of the sensor's noise, as sRGB in [0, 1].
    """

    sky: Floats
    ground: Floats
    lamps: tuple[Lamp, ...]
    exposure: float
    contrast: float
    noise: float

    @property
    def colours(self) -> Floats:
        """(2 + L, 3) colours of the sky, of the ground, and of each lamp."""
        return np.stack([self.sky, self.ground, *[lamp.colour for lamp in self.lamps]])


@dataclass(frozen=True, slots=True)
class Gloss:
    """How a surface shines (Blinn and Phong): strength, 0 for a matt one, and sharpness."""

    strength: float
    sharpness: float

    def share(self, normals: Floats, toward_lamp: Floats, toward_camera: Floats) -> Floats:
        """(N,) of a lamp's light that is reflected as from a mirror; unit directions (N, 3)."""
        half = toward_lamp + toward_camera
        half /= np.linalg.norm(half, axis=1, keepdims=True).clip(1e-9)
        facing = np.maximum((normals * half).sum(axis=1), 0.0)
        return self.strength * facing**self.sharpness * (self.sharpness + 8.0) / 8.0


def drawn_light(camera: Camera, draw: np.random.Generator) -> Light:
    """Light around the subject of a camera; most of it from the camera's side and from above."""
    return light_of(tuple(drawn_lamp(camera, draw) for _ in range(draw.choice(_LAMPS))), draw)


def light_of(lamps: tuple[Lamp, ...], draw: np.random.Generator) -> Light:
    """Some lamps, and around them a drawn sky and ground; a drawn exposure."""
    sky = draw.uniform(0.1 if lamps else 0.6, 0.9) * _tint(draw)
    return Light(
        sky=sky,
        ground=draw.uniform(*_GROUND) * sky * _tint(draw),
        lamps=lamps,
        exposure=float(np.exp(draw.normal(0.0, 0.2))),
        contrast=float(np.exp(draw.normal(0.0, 0.12))),
        noise=float(draw.uniform(0.0, 0.015)),
    )


def sky_and_ground(normals: Floats) -> Floats:
    """(N, 2) shares of both that arrive on open surfaces with normals (N, 3), world frame."""
    above = (1.0 + normals[:, 1]) / 2.0
    return np.stack([above, 1.0 - above], axis=1)


def drawn_gloss(draw: np.random.Generator) -> Gloss:
    """Mostly none; else from a faint sheen to leather and satin."""
    if draw.random() < _MATT:
        return Gloss(0.0, 1.0)
    sharpness = math.exp(draw.uniform(*np.log(_SHARPNESS)))
    return Gloss(float(draw.uniform(*_GLOSS)), sharpness)


def drawn_lamp(camera: Camera, draw: np.random.Generator) -> Lamp:
    """A lamp on the camera's side of the subject, mostly above it."""
    distance = draw.uniform(1.5, 4.0)
    across, height = draw.uniform(-80, 80), draw.uniform(-15, 75)
    turn, lift = math.radians(across), math.radians(height)
    # Camera axes: x right, y down, z forward; the lamp is seen from the subject.
    toward = np.array(
        [math.cos(lift) * math.sin(turn), -math.sin(lift), -math.cos(lift) * math.cos(turn)]
    )
    centre = distance * toward @ camera.rotation
    radius = math.exp(draw.uniform(*np.log(_RADIUS_M)))
    points = centre + radius * draw.uniform(-1, 1, (_LAMP_POINTS, 3))
    return Lamp(points, drawn_lamp_colour(draw))


def drawn_lamp_colour(draw: np.random.Generator) -> Floats:
    """(3,) linear light of a lamp on a surface that faces it."""
    return draw.uniform(0.15, 0.9) * _tint(draw)


def _tint(draw: np.random.Generator) -> Floats:
    return np.exp(draw.normal(0.0, _TINT, 3))


def photographed(linear: Floats, light: Light, draw: np.random.Generator) -> Floats:
    """Colours in [0, 1], sRGB, of linear light (..., 3): exposed, clipped, with sensor noise."""
    picture = srgb_from_linear(np.clip(light.exposure * linear, 0.0, 1.0)) ** light.contrast
    return np.clip(picture + light.noise * draw.normal(size=picture.shape), 0.0, 1.0)


def packed_lights(lights: Floats) -> Bytes:
    """Shares of light, 0 to 1, as bytes; their roots, because eyes and photos tell dark ones apart.

    ``relighting.unpacked_lights`` is their inverse.
    """
    return np.round(255.0 * np.sqrt(np.clip(lights, 0.0, 1.0))).astype(np.uint8)
