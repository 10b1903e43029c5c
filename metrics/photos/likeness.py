"""PSNR and SSIM of two pictures within a mask, each with one stated definition.

Pictures are sRGB in [0, 1]. PSNR is ``10 log10(1 / MSE)`` over all pixels of the mask and the three
channels, at most ``MOST_DB``. SSIM is that of Wang, Bovik, Sheikh and Simoncelli (2004): a Gaussian
window of 11 x 11 pixels with a standard deviation of 1.5, weights that sum to 1, K1 = 0.01,
K2 = 0.03 and a range of 1. It is computed for each channel, and the mean is taken over the channels
and over the pixels whose whole window lies within the mask, so that no background takes part.
"""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError
from harness.core.quality.photo_scores import Likeness

#: What pictures that do not differ score, instead of infinity.
MOST_DB = 100.0
_WINDOW, _DEVIATION = 11, 1.5
_C1, _C2 = 0.01**2, 0.03**2


def likeness(picture: Floats, photo: Floats, mask: Mask) -> Likeness | None:
    """PSNR and SSIM of two pictures (H, W, 3) within a mask (H, W); None where it is empty.

    Raises:
        DataError: pictures or mask of different sizes.
    """
    _check(picture, photo)
    if mask.shape != picture.shape[:2]:
        raise DataError("a mask is not of its picture's size", got=f"{mask.shape}")
    if not mask.any():
        return None
    inner = _inner(mask)
    ssim = None
    if inner.any():
        maps = [ssim_map(picture[..., c], photo[..., c])[inner].mean() for c in range(3)]
        ssim = float(np.mean(maps))
    return Likeness(psnr_db(picture[mask], photo[mask]), ssim, int(mask.sum()))


def psnr_db(picture: Floats, photo: Floats) -> float:
    """Peak signal to noise ratio of values in [0, 1], decibels, at most ``MOST_DB``."""
    _check(picture, photo)
    error = float(np.mean((picture - photo) ** 2))
    return MOST_DB if error == 0 else min(MOST_DB, 10.0 * float(np.log10(1.0 / error)))


def ssim_map(picture: Floats, photo: Floats) -> Floats:
    """(H, W) structural similarity of two pictures (H, W) of one channel, in [0, 1].

    Within half a window of the border, the picture is continued by reflection.
    """
    _check(picture, photo)
    mean_a, mean_b = _windowed(picture), _windowed(photo)
    variance_a = _windowed(picture**2) - mean_a**2
    variance_b = _windowed(photo**2) - mean_b**2
    covariance = _windowed(picture * photo) - mean_a * mean_b
    likeness_ = (2.0 * mean_a * mean_b + _C1) * (2.0 * covariance + _C2)
    return likeness_ / ((mean_a**2 + mean_b**2 + _C1) * (variance_a + variance_b + _C2))


def _check(picture: Floats, photo: Floats) -> None:
    if picture.shape != photo.shape:
        raise DataError(
            "two pictures of different sizes cannot be compared",
            expected=str(photo.shape),
            got=str(picture.shape),
        )


def _windowed(values: Floats) -> Floats:
    """(H, W) mean in the Gaussian window around each pixel."""
    from scipy.ndimage import correlate1d

    offset = np.arange(_WINDOW) - _WINDOW // 2
    weights = np.exp(-0.5 * (offset / _DEVIATION) ** 2)
    weights /= weights.sum()
    along = correlate1d(values, weights, axis=0, mode="reflect")
    return np.asarray(correlate1d(along, weights, axis=1, mode="reflect"))


def _inner(mask: Mask) -> Mask:
    """(H, W) where the whole window lies within the mask and the picture."""
    from scipy.ndimage import minimum_filter

    held = minimum_filter(mask.astype(np.uint8), size=_WINDOW, mode="constant", cval=0)
    return np.asarray(held, dtype=bool)
