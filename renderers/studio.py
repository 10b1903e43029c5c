"""The studio: a turntable under fixed lamps.

Even light from all directions keeps the colours of the texture. A large soft key light at the upper
left of the camera makes the shading in which folds are visible. The key light moves with the
camera, as if the subject turned in a fixed studio, so that every view has the same light.

Both strengths have one unit: the radiance of a white, unshaded surface that faces the light. A sum
of 1 therefore just reaches the picture's white.
"""

from __future__ import annotations

import math

import numpy as np

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera

#: Side of the square key light, metres.
KEY_SIDE_M = 1.6
#: Its position relative to the camera: right, down, forward, as shares of the camera's distance.
_KEY_OFFSET = (-0.55, -0.65, 0.15)


def key_light_position(camera: Camera) -> Floats:
    """(3,) world metres of the key light's centre; it is aimed at the world's origin."""
    distance = float(np.linalg.norm(camera.position))
    return camera.position + distance * np.array(_KEY_OFFSET) @ camera.rotation


def square_light_radiance(strength: float, distance_m: float, side_m: float = KEY_SIDE_M) -> float:
    """Radiance of a square light that makes a facing white surface radiate ``strength``.

    ``strength`` over the form factor from a small surface to a centred, parallel square:
    F = 4/pi * s * atan(s), with s = sin of the half side's angle (Howell, configuration C-3).
    """
    s = math.sin(math.atan2(side_m / 2, distance_m))
    return strength / (4 / math.pi * s * math.atan(s))
