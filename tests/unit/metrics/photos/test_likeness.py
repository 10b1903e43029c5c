"""PSNR and SSIM against closed forms and another implementation."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError
from metrics.photos import MOST_DB, likeness, psnr_db, ssim_map


@pytest.fixture
def pictures():
    """A smooth picture, and the same with noise and another contrast, in [0, 1]."""
    rng = np.random.default_rng(3)
    rows, columns = np.mgrid[:60, :80]
    base = np.stack([0.5 + 0.4 * np.sin(rows / 7 + k) * np.cos(columns / 5) for k in range(3)], -1)
    other = np.clip(0.8 * base + 0.1 + 0.05 * rng.standard_normal(base.shape), 0, 1)
    return base, other


def test_psnr_of_a_constant_difference_is_its_closed_form():
    black, grey = np.zeros((4, 5, 3)), np.full((4, 5, 3), 0.1)
    assert psnr_db(black, grey) == pytest.approx(20.0)
    assert psnr_db(grey, grey) == MOST_DB
    # Half of the pixels differ by 0.1: the mean square is half as large.
    grey[:2] = 0.0
    assert psnr_db(black, grey) == pytest.approx(20.0 + 10 * np.log10(2))


def test_ssim_is_that_of_another_implementation(pictures):
    from skimage.metrics import structural_similarity

    first, second = pictures
    for channel in range(3):
        one, other = first[..., channel], second[..., channel]
        _, expected = structural_similarity(
            one, other, data_range=1.0, gaussian_weights=True, sigma=1.5,
            use_sample_covariance=False, full=True,
        )  # fmt: skip
        np.testing.assert_allclose(ssim_map(one, other), expected, atol=1e-10)


def test_ssim_of_constants_is_its_closed_form():
    one, other = np.full((30, 30), 0.2), np.full((30, 30), 0.6)
    expected = (2 * 0.2 * 0.6 + 1e-4) / (0.2**2 + 0.6**2 + 1e-4)
    np.testing.assert_allclose(ssim_map(one, other), expected)
    np.testing.assert_allclose(ssim_map(one, one), 1.0)


def test_only_what_lies_within_the_mask_counts(pictures):
    first, second = pictures
    mask = np.zeros(first.shape[:2], dtype=bool)
    mask[10:50, 20:70] = True
    found = likeness(first, second, mask)
    assert found is not None
    assert found.pixels == 40 * 50
    beside = np.where(mask[..., None], second, 0.0)
    assert likeness(first, beside, mask) == found
    whole = [ssim_map(first[..., c], second[..., c])[15:45, 25:65].mean() for c in range(3)]
    assert found.ssim == pytest.approx(np.mean(whole))
    assert found.psnr_db == pytest.approx(psnr_db(first[10:50, 20:70], second[10:50, 20:70]))


def test_a_mask_without_a_whole_window_has_no_ssim_and_an_empty_one_nothing(pictures):
    first, second = pictures
    thin = np.zeros(first.shape[:2], dtype=bool)
    thin[20:30] = True
    found = likeness(first, second, thin)
    assert found is not None
    assert found.ssim is None
    assert likeness(first, second, np.zeros_like(thin)) is None


def test_pictures_of_different_sizes_are_refused(pictures):
    first, second = pictures
    mask = np.ones(first.shape[:2], dtype=bool)
    with pytest.raises(DataError, match="different sizes"):
        likeness(first[:-1], second, mask)
    with pytest.raises(DataError, match="mask"):
        likeness(first, second, mask[:-1])
