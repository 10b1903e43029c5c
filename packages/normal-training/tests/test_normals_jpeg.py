"""A compressed picture is what a JPEG file of it would be read as."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

torch = pytest.importorskip("torch")

from normal_training.learning.variations.jpeg import compressed  # noqa: E402


def picture(height=60, width=76, seed=0):
    """Smooth colours, an edge and some grain."""
    draw = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width] / height
    waves = np.stack([np.sin(7 * x + 2 * y), np.cos(5 * y), np.sin(4 * (x - y))])
    light = 0.5 + 0.35 * waves + 0.03 * draw.normal(size=waves.shape)
    light[:, :, width // 2 :] *= 0.6
    return torch.from_numpy(np.clip(light, 0, 1)).float()


def from_file(light, quality):
    pixels = (255 * light).round().byte().movedim(0, -1).numpy()
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=quality)
    with Image.open(file) as read:
        return torch.from_numpy(np.asarray(read, np.float32) / 255).movedim(-1, 0)


@pytest.mark.parametrize("quality", [25, 49, 50, 85, 100])
def test_it_is_what_a_file_would_be_read_as(quality):
    light = picture()
    wanted, found = from_file(light, quality), compressed(light, quality)
    assert found.shape == light.shape
    # A cosine near the middle of two steps may be rounded to either.
    off, lost = (float((other - wanted).abs().mean()) for other in (found, light))
    assert off < 1.5 / 255
    assert off < 0.25 * lost


def test_an_even_picture_stays():
    grey = torch.full((3, 17, 33), 128 / 255)
    torch.testing.assert_close(compressed(grey, 30), grey)


def test_less_quality_loses_more():
    light = picture()[:1].expand(3, -1, -1)
    losses = [float((compressed(light, quality) - light).abs().mean()) for quality in (90, 60, 25)]
    assert losses == sorted(losses)
    assert losses[0] < 0.6 * losses[2]
