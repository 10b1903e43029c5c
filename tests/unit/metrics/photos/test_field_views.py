"""Recipes of the field for rendered views, against closed forms and scikit-image."""

import numpy as np
import pytest
from scipy.signal import convolve2d
from skimage.metrics import structural_similarity

from harness.core.errors import DataError
from metrics.photos import ACTORSHQ, BLACK1024, ms_ssim, view_numbers


def pictures():
    random = np.random.default_rng(0)
    photo = np.round(random.random((60, 40, 3)) * 200) / 255
    mask = np.zeros((60, 40), dtype=bool)
    mask[10:50, 8:30] = True
    return photo, mask


def test_psnr_is_over_the_mask_for_actorshq_and_over_the_crop_for_black1024():
    photo, mask = pictures()
    rendered = photo + 10 / 255
    rendered[~mask] = 1.0
    expected = 20 * np.log10(255 / 10)
    assert view_numbers(rendered, photo, mask, ACTORSHQ)["psnr"] == pytest.approx(expected)
    # The background is black in both, and its pixels count: the margin of 8 pixels after scaling.
    found = view_numbers(rendered, photo, mask, BLACK1024)["psnr"]
    scale = 1024 / 40
    inside = (40 * scale) * (22 * scale)
    crop = (40 * scale + 16) * (22 * scale + 16)
    assert found == pytest.approx(expected + 10 * np.log10(crop / inside), abs=0.02)


def test_pictures_are_rounded_to_8_bits_first():
    photo, mask = pictures()
    assert view_numbers(photo + 0.4 / 255, photo, mask, ACTORSHQ)["psnr"] == 100


def test_ssim_is_scikit_images():
    photo, mask = pictures()
    rendered = np.round(np.clip(photo[..., ::-1] * 0.8, 0, 1) * 255) / 255
    found = view_numbers(rendered, photo, mask, ACTORSHQ)["ssim"]
    crop = slice(10, 50), slice(8, 30)
    expected = structural_similarity(photo[crop], rendered[crop], data_range=1, channel_axis=2)
    assert found == pytest.approx(expected)


def plain_ms_ssim(mine, true):
    """With whole convolutions, on one channel."""
    line = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    window = np.outer(line, line) / line.sum() ** 2
    blur = lambda values: convolve2d(values, window, mode="valid")  # noqa: E731
    found = 1.0
    for k, weight in enumerate([0.0448, 0.2856, 0.3001, 0.2363, 0.1333]):
        a, b = blur(mine), blur(true)
        c1, c2 = 0.01**2, 0.03**2
        cov = blur(mine * true) - a * b
        cs = (2 * cov + c2) / (blur(mine**2) - a**2 + blur(true**2) - b**2 + c2)
        light = (2 * a * b + c1) / (a**2 + b**2 + c1) if k == 4 else 1.0
        found *= np.mean(light * cs) ** weight
        mine, true = (
            (x[::2, ::2] + x[1::2, ::2] + x[::2, 1::2] + x[1::2, 1::2]) / 4 for x in (mine, true)
        )
    return found


def test_ms_ssim_is_that_of_a_plain_reimplementation():
    random = np.random.default_rng(1)
    photo = random.random((224, 192, 3)).cumsum(axis=0) % 1.0
    rendered = np.clip(photo + random.normal(size=photo.shape) * 0.1, 0, 1)
    expected = np.mean([plain_ms_ssim(rendered[..., c], photo[..., c]) for c in range(3)])
    assert ms_ssim(rendered, photo) == pytest.approx(expected, abs=1e-9)
    assert ms_ssim(photo, photo) == pytest.approx(1)
    mask = np.ones(photo.shape[:2], dtype=bool)
    assert "ms_ssim" in view_numbers(rendered, photo, mask, ACTORSHQ)


def test_ms_ssim_of_even_grey_is_its_luminance_at_the_coarsest_scale_alone():
    dark, light = np.full((176, 176, 1), 0.2), np.full((176, 176, 1), 0.6)
    alike = (2 * 0.2 * 0.6 + 1e-4) / (0.2**2 + 0.6**2 + 1e-4)
    assert ms_ssim(dark, light) == pytest.approx(alike**0.1333)
    assert ms_ssim(dark[:175], light[:175]) is None


def test_an_empty_mask_is_refused():
    photo, mask = pictures()
    with pytest.raises(DataError, match="cannot be compared"):
        view_numbers(photo, photo, mask & False, ACTORSHQ)
