"""A photo of the subject as stereo sees it: brightness, where the subject is, and the camera."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.ndimage import convolve, gaussian_filter

from harness.core.arrays import Bytes, Floats, Mask, Singles
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.geometry.images import resampled

#: The value of pixels that do not show the subject, far from every contrast.
OUTSIDE = -100.0
#: Pixels of the frame that are kept around the subject.
_MARGIN_PX = 4
#: Darker means than this, in grey levels, would blow their noise up.
_DARKEST = 10.0
#: Immerkaer 1996: the mask that neither planes nor edges answer, and its norm.
_NOISE_MASK = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]], dtype=np.float32)
_NOISE_NORM = 6.0
#: Noise is what the plainest tenth of the blocks of 16 x 16 pixels shows.
_BLOCK_PX, _PLAINEST = 16, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class StereoView:
    """One calibrated photo, cut to the window of the subject.

    Attributes:
        camera: The window's camera.
        grey: (H, W) brightness, 0 to 255, not premultiplied.
        coverage: (H, W) share of each pixel that shows the subject.
    """

    camera: Camera
    grey: Singles
    coverage: Singles

    def __post_init__(self) -> None:
        size = (self.camera.height, self.camera.width)
        if self.grey.shape != size or self.coverage.shape != size:
            raise MethodError(
                "a photo does not fit its camera",
                expected=f"shape {size}",
                got=f"grey {self.grey.shape}, coverage {self.coverage.shape}",
            )


def stereo_view(camera: Camera, rgba: Bytes) -> StereoView:
    """A photo (H, W, 4), sRGB and coverage, cut to the subject's window.

    Raises:
        MethodError: the photo shows nothing of the subject, or is of another size.
    """
    if rgba.shape != (camera.height, camera.width, 4):
        raise MethodError(
            "a photo does not fit its camera",
            expected=f"shape {(camera.height, camera.width, 4)}",
            got=f"shape {rgba.shape}",
        )
    rows, columns = (np.flatnonzero((rgba[..., 3] > 0).any(axis=axis)) for axis in (1, 0))
    if len(rows) == 0:
        raise MethodError("a photo does not show the subject", got="an empty mask")
    top, left = max(rows[0] - _MARGIN_PX, 0), max(columns[0] - _MARGIN_PX, 0)
    bottom = min(rows[-1] + 1 + _MARGIN_PX, camera.height)
    right = min(columns[-1] + 1 + _MARGIN_PX, camera.width)
    window = rgba[top:bottom, left:right]
    return StereoView(
        camera=camera.cropped(int(left), int(top), int(right - left), int(bottom - top)),
        grey=window[..., :3].mean(axis=2, dtype=np.float32),
        coverage=window[..., 3].astype(np.float32) / np.float32(255.0),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Contrast:
    """A photo without its slow light and shade, ready to be matched.

    Attributes:
        camera: Camera of these pixels.
        values: (H, W) relative differences from the local mean; ``OUTSIDE`` beside the subject.
        noise: Standard deviation of the values where the subject is plainest.
        made: What else was made of the values, by name: it goes when they go.
    """

    camera: Camera
    values: Singles
    noise: float
    made: dict[str, Any] = field(default_factory=dict[str, Any], repr=False)

    @property
    def mask(self) -> Mask:
        """(H, W) where the subject is."""
        return self.values > OUTSIDE / 2


def reduction(camera: Camera, centre: Floats, pixel_m: float) -> int:
    """By which whole number a photo is made smaller so that a pixel spans about ``pixel_m``.

    Args:
        camera: The photo's camera.
        centre: (3,) of the subject, world metres.
        pixel_m: At the depth of the centre.
    """
    _, depth = camera.project(centre[None])
    return max(1, round(pixel_m * camera.K[0, 0] / max(float(camera.spread(depth[0])), 1e-6)))


def contrast(view: StereoView, down: int, flatten_px: float) -> Contrast:
    """What is left of a photo when its local mean is taken away and divided by.

    Brightness minus a Gaussian mean of the subject's own pixels, over that mean: exposure and slow
    shading cancel.

    Args:
        view: The photo.
        down: By how much it is made smaller.
        flatten_px: Width of the Gaussian, in pixels of the smaller picture.
    """
    camera, grey, coverage = view.camera, view.grey, view.coverage
    if down > 1:
        size = max(1, camera.width // down), max(1, camera.height // down)
        camera = camera.resized(*size)
        shown = resampled(coverage.astype(np.float64), size, "box")
        lit = resampled((grey * coverage).astype(np.float64), size, "box")
        grey = (lit / np.maximum(shown, 1e-3)).astype(np.float32)
        coverage = shown.astype(np.float32)
    inside = (coverage > 0.5).astype(np.float32)
    weight = np.maximum(gaussian_filter(inside, flatten_px, truncate=3.0), 1e-3)
    mean = gaussian_filter(grey * inside, flatten_px, truncate=3.0) / weight
    values = ((grey - mean) / np.maximum(mean, _DARKEST)).astype(np.float32)
    noise = _noise(values, inside > 0)
    return Contrast(camera, np.where(inside > 0, values, np.float32(OUTSIDE)), noise)


def _noise(values: Singles, mask: Mask) -> float:
    """Standard deviation of what differs from pixel to pixel where the picture is plainest."""
    answer = convolve(values, _NOISE_MASK, mode="nearest") / _NOISE_NORM
    whole = convolve(mask.astype(np.float32), np.ones((3, 3), np.float32), mode="constant") > 8.5
    rows, columns = (n // _BLOCK_PX * _BLOCK_PX for n in values.shape)
    blocks = (rows // _BLOCK_PX, _BLOCK_PX, columns // _BLOCK_PX, _BLOCK_PX)
    energy = np.where(whole, answer, 0.0)[:rows, :columns] ** 2
    count = whole[:rows, :columns].reshape(blocks).sum(axis=(1, 3))
    full = count > _BLOCK_PX**2 / 2
    if not full.any():
        return 0.0
    variances = energy.reshape(blocks).sum(axis=(1, 3))[full] / count[full]
    return float(np.sqrt(np.quantile(variances, _PLAINEST)))
