"""Recipes of the field for rendered views, against closed forms and scikit-image."""

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from harness.core.errors import DataError
from metrics.photos import ACTORSHQ, BLACK1024, view_numbers


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


def test_an_empty_mask_is_refused():
    photo, mask = pictures()
    with pytest.raises(DataError, match="cannot be compared"):
        view_numbers(photo, photo, mask & False, ACTORSHQ)
