"""PSNR and SSIM of a rendered view by the fixed recipes of the field, with nothing fitted.

Our own figures of photos (``likeness``) fit an exposure first and leave out the background. Here a
recipe fixes crop, mask, background and rounding. LPIPS needs networks that are not part of this.

Source: HumanRF, ``actorshq/evaluation/evaluate.py``; Diffuman4D, ``metric_utils.py`` of its code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.errors import DataError
from metrics.photos.likeness import psnr_db, ssim_map

_HALF_WINDOW = 5


@dataclass(frozen=True, slots=True)
class ViewRecipe:
    """How two pictures become numbers.

    Attributes:
        name: As in tables.
        version: Changes whenever the numbers may change for equal pictures.
        margin_px: What is left around the box of the true mask.
        background: ``kept``, or ``black`` outside the true mask in both.
        psnr_over: Pixels of the ``mask``, or of the ``crop``.
        ssim: ``uniform`` windows of 7 pixels with the sample covariance, as scikit-image's default;
            ``gaussian`` ones of 11, without the border.
        shorter_px: The shorter side is brought to this first, by nearest pixels; 0 keeps the size.
    """

    name: str
    version: int
    margin_px: int
    background: Literal["kept", "black"]
    psnr_over: Literal["mask", "crop"]
    ssim: Literal["uniform", "gaussian"]
    shorter_px: int = 0


ACTORSHQ = ViewRecipe("nvs-actorshq", 1, 0, "kept", "mask", "uniform")
BLACK1024 = ViewRecipe("nvs-black1024", 1, 8, "black", "crop", "gaussian", 1024)
VIEW_RECIPES: Mapping[str, ViewRecipe] = {each.name: each for each in (ACTORSHQ, BLACK1024)}


def view_numbers(
    rendered: Floats, photo: Floats, mask: Mask, recipe: ViewRecipe
) -> dict[str, float]:
    """``psnr`` in dB and ``ssim`` of pictures (H, W, 3) in [0, 1], both rounded to 8 bits first.

    Args:
        rendered: What a method made.
        photo: The true picture.
        mask: (H, W) the subject's in the true picture.
        recipe: How.

    Raises:
        DataError: pictures of different sizes, or an empty mask.
    """
    if rendered.shape != photo.shape or mask.shape != photo.shape[:2] or not mask.any():
        raise DataError(
            "two views cannot be compared",
            expected=f"pictures of {photo.shape[:2]} pixels and a mask that is not empty",
            got=f"{rendered.shape[:2]} and a mask of {mask.shape}, {int(mask.sum())} pixels in it",
        )
    chosen = _nearest(mask.shape, recipe.shorter_px)
    mask = mask[chosen]
    pictures = [np.round(np.clip(each[chosen], 0, 1) * 255) / 255 for each in (rendered, photo)]
    if recipe.background == "black":
        pictures = [each * mask[..., None] for each in pictures]
    box = _box(mask, recipe.margin_px)
    mine, true = (each[box] for each in pictures)
    within = mask[box] if recipe.psnr_over == "mask" else np.ones(mask[box].shape, dtype=bool)
    return {"psnr": psnr_db(mine[within], true[within]), "ssim": _ssim(mine, true, recipe.ssim)}


def _nearest(shape: tuple[int, ...], shorter_px: int) -> tuple[Ints, Ints]:
    """Rows and columns of the pixels that a picture of another size takes."""
    scale = shorter_px / min(shape) if shorter_px else 1.0
    axes = (
        np.minimum((np.arange(round(side * scale)) / scale).astype(int), side - 1) for side in shape
    )
    rows, columns = np.ix_(*axes)
    return rows, columns


def _box(mask: Mask, margin: int) -> tuple[slice, slice]:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return (
        slice(max(0, int(rows[0]) - margin), int(rows[-1]) + 1 + margin),
        slice(max(0, int(columns[0]) - margin), int(columns[-1]) + 1 + margin),
    )


def _ssim(mine: Floats, true: Floats, windows: str) -> float:
    if windows == "uniform":
        from skimage.metrics import structural_similarity

        similarity: Any = structural_similarity(true, mine, data_range=1.0, channel_axis=2)
        return float(similarity)
    inner = slice(_HALF_WINDOW, -_HALF_WINDOW)
    maps = [ssim_map(mine[..., c], true[..., c])[inner, inner].mean() for c in range(3)]
    return float(np.mean(maps))
