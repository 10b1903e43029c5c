"""Light adds up: a stored photo in another light is what that light would have shown."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from harness.geometry.images import linear_from_srgb  # noqa: E402
from normal_training.learning.variations import relighting  # noqa: E402
from normal_training.learning.variations.light import (  # noqa: E402
    Lamp,
    Light,
    packed_lights,
    photographed,
)
from normal_training.learning.variations.relighting import (  # noqa: E402
    developed,
    relit,
    unpacked_lights,
)


def source(seed):
    return torch.Generator().manual_seed(seed)


def relit_pixels(albedo, lights, coverage, seed=0):
    pixels = (torch.from_numpy(values) for values in (albedo, lights, coverage))
    return relit(*pixels, source(seed)).numpy()


def plain_light(lamps):
    """White light of known strengths, without noise."""
    return Light(np.full(3, 0.5), np.full(3, 0.25), lamps, exposure=1.0, contrast=1.0, noise=0.0)


def test_packed_lights_come_back():
    lights = np.linspace(0, 1, 300)[:, None]
    np.testing.assert_allclose(
        unpacked_lights(torch.from_numpy(packed_lights(lights))), lights, atol=0.005
    )
    assert packed_lights(np.array([-0.1, 1.2])).tolist() == [0, 255]


def test_light_of_sky_ground_and_lamps_adds_up(monkeypatch):
    monkeypatch.setattr(relighting, "_SHINING", 1.1)
    monkeypatch.setattr(relighting, "drawn_lamp_colour", lambda draw: np.array([0.2, 0.1, 0.0]))
    monkeypatch.setattr(relighting, "light_of", lambda lamps, draw: plain_light(lamps))
    albedo = np.full((3, 3), 200, np.uint8)
    lights = packed_lights(np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 1, 0.5]]))
    picture = relit_pixels(albedo, lights, np.full(3, 255, np.uint8))
    arriving = np.array([[0.5] * 3, [0.25] * 3, [0.375 + 0.3, 0.375 + 0.15, 0.375]])
    wanted = linear_from_srgb(200 / 255.0) * arriving
    np.testing.assert_allclose(linear_from_srgb(picture / 255.0), wanted, atol=0.006)


def test_rims_are_blended_over_black_by_their_coverage():
    albedo, lights = np.full((2, 3), 220, np.uint8), np.full((2, 4), 255, np.uint8)
    coverage = np.array([255, 153], np.uint8)

    def quiet(linear, light, draw):
        return torch.full(linear.shape, 0.5)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(relighting, "developed", quiet)
        picture = relit_pixels(albedo, lights, coverage)
    assert picture[:, 0].tolist() == [128, 76]


def test_lamps_are_on_in_some_photos_and_off_in_others(monkeypatch):
    counts = []

    def counted(lamps: tuple[Lamp, ...], draw):
        counts.append(len(lamps))
        return plain_light(lamps)

    monkeypatch.setattr(relighting, "light_of", counted)
    dark = np.zeros((1, 4), np.uint8)
    for seed in range(40):
        relit_pixels(dark[:, :3], dark, dark[:, 0], seed)
    assert set(counts) == {0, 1, 2}


def test_equal_seeds_give_equal_light():
    draw = np.random.default_rng(5)
    albedo, lights = (draw.integers(0, 256, (20, n), dtype=np.uint8) for n in (3, 4))
    coverage = np.full(20, 255, np.uint8)
    one, again, other = (relit_pixels(albedo, lights, coverage, seed) for seed in (1, 1, 2))
    assert (one == again).all()
    assert (one != other).any()


def test_a_device_develops_as_numpy_does():
    linear = np.random.default_rng(0).uniform(0, 1.4, (50, 3)) ** 3
    light = Light(np.ones(3), np.ones(3), (), exposure=1.2, contrast=0.9, noise=0.0)
    wanted = photographed(linear, light, np.random.default_rng(0))
    found = developed(torch.from_numpy(linear), light, source(0))
    np.testing.assert_allclose(found.numpy(), wanted, atol=1e-6)
