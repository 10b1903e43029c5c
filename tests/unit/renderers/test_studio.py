"""The studio's lights against numerical integrals and hand-placed cameras."""

import numpy as np
import pytest

from harness.core.rigs import RingRig
from renderers.capture import key_light_position, square_light_radiance


@pytest.mark.parametrize(("distance", "side"), [(3.0, 1.6), (0.5, 1.0), (10.0, 0.2)])
def test_a_square_light_gives_the_strength_that_was_asked_for(distance, side):
    # Radiance times the projected solid angle over pi, integrated over the square.
    x = (np.arange(800) + 0.5) / 800 * side - side / 2
    squared = x[:, None] ** 2 + x[None, :] ** 2 + distance**2
    form_factor = (distance**2 / (np.pi * squared**2)).sum() * (side / 800) ** 2
    assert square_light_radiance(0.7, distance, side) * form_factor == pytest.approx(0.7, rel=1e-4)


def test_the_key_light_is_at_the_cameras_upper_left():
    for camera in RingRig(views=5, pitch_deg=20).cameras(90, 160):
        x, y, z = camera.rotation @ (key_light_position(camera) - camera.position)
        assert x < 0, "left"
        assert y < 0, "up: image y points down"
        assert np.linalg.norm(key_light_position(camera)) > 2.0
        # It lights what the camera sees.
        assert key_light_position(camera) @ camera.position > 0
        assert z < 3.0
