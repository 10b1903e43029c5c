"""Oriented points: what every source ends in, and what Poisson reconstruction starts from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Bytes, Floats, Mask
from harness.core.camera import Camera
from harness.core.errors import DataError
from harness.geometry.images import resampled


@dataclass(frozen=True, slots=True, eq=False)
class OrientedPoints:
    """Points of a surface with the side that they face, world metres.

    Attributes:
        positions: (N, 3).
        normals: (N, 3) unit, outwards.
    """

    positions: Floats
    normals: Floats

    def __len__(self) -> int:
        return len(self.positions)

    def chosen(self, keep: Mask) -> OrientedPoints:
        """Those where ``keep`` (N,) holds."""
        return OrientedPoints(self.positions[keep], self.normals[keep])

    @classmethod
    def joined(cls, parts: Sequence[OrientedPoints]) -> OrientedPoints:
        """All parts, one after the other."""
        if not parts:
            return cls(np.zeros((0, 3)), np.zeros((0, 3)))
        return cls(
            np.concatenate([part.positions for part in parts]),
            np.concatenate([part.normals for part in parts]),
        )

    def thinned(self, cell_m: float) -> OrientedPoints:
        """One point for each cell and side: the mean of those that face about the same way.

        The two sides of a thin sheet share a cell but not a direction, and stay apart.
        """
        if cell_m <= 0 or len(self) == 0:
            return self
        cells = np.floor(self.positions / cell_m).astype(np.int64)
        side = ((self.normals > 0) * np.array([1, 2, 4])).sum(axis=1)
        key = np.column_stack([cells, side])
        _, owner = np.unique(key, axis=0, return_inverse=True)
        owner = owner.ravel()
        count = int(owner.max()) + 1
        weight = np.bincount(owner, minlength=count)[:, None]

        def total(values: Floats) -> Floats:
            sums = [np.bincount(owner, axis, count) for axis in values.T]
            return np.stack(sums, axis=1).astype(np.float64)

        normals = total(self.normals)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return OrientedPoints(total(self.positions) / weight, normals / np.maximum(length, 1e-9))


#: ``pad`` shows all of a photo on a square, ``fit`` all of it without the padding, and ``crop``
#: fills the width and cuts what is taller than the square.
Fit = Literal["pad", "fit", "crop"]
Number = TypeVar("Number", bound=np.generic)


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture made of a photo by resizing it, then shifting it into another frame.

    Attributes:
        photo: Width and height of the photo, pixels.
        resized: Width and height that the whole photo was resized to.
        shift: Where its left and top edges are in the picture; negative where they are cut off.
        size: Width and height of the picture.
    """

    photo: tuple[int, int]
    resized: tuple[int, int]
    shift: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def whole(cls, photo: tuple[int, int], size: tuple[int, int]) -> Frame:
        """The whole photo at another size."""
        return cls(photo, size, (0, 0), size)

    @property
    def scale(self) -> tuple[float, float]:
        """Pixels of the picture per pixel of the photo, along x and y."""
        return self.resized[0] / self.photo[0], self.resized[1] / self.photo[1]

    def camera(self, camera: Camera) -> Camera:
        """The photo's camera, on the picture's pixels.

        Raises:
            DataError: a camera of another photo size.
        """
        if camera.size != self.photo:
            raise DataError(
                "a camera does not fit its photo",
                expected=f"{self.photo[0]} x {self.photo[1]} pixels",
                got=f"{camera.width} x {camera.height}",
            )
        scaled = camera.resized(*self.resized)
        left, top = self.shift
        return scaled.cropped(-left, -top, *self.size)

    def placed(self, picture: NDArray[Number], filling: float) -> NDArray[Number]:
        """The resized photo (h, w) or (h, w, C) in the picture's frame, with a filling around."""
        width, height = self.size
        left, top = self.shift
        canvas = np.full((height, width, *picture.shape[2:]), filling, dtype=picture.dtype)
        rows = slice(max(top, 0), min(top + self.resized[1], height))
        columns = slice(max(left, 0), min(left + self.resized[0], width))
        canvas[rows, columns] = picture[
            rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
        ]
        return canvas

    def coverage(self, coverage: Floats) -> Floats:
        """The photo's coverage (H, W), on the picture's pixels; 0 where the picture is padded."""
        smaller = self.resized[0] < self.photo[0]
        shrunk = resampled(coverage, self.resized, "box" if smaller else "bilinear")
        return self.placed(shrunk, 0.0)


def fitted_frame(photo: tuple[int, int], side: int, patch: int, fit: Fit) -> Frame:
    """The frame of a photo for a network with square patches.

    Args:
        photo: Width and height, pixels.
        side: Longest side of the picture; with ``crop`` its width.
        patch: Both sides of the picture are multiples of this.
        fit: See ``Fit``.
    """
    width, height = photo
    if fit == "crop" or width >= height:
        resized = side, _multiple(height * (side / width), patch)
    else:
        resized = _multiple(width * (side / height), patch), side
    if fit == "crop":
        cut = max(resized[1] - side, 0)
        return Frame(photo, resized, (0, -(cut // 2)), (side, min(resized[1], side)))
    if fit == "fit":
        return Frame(photo, resized, (0, 0), resized)
    shift = (side - resized[0]) // 2, (side - resized[1]) // 2
    return Frame(photo, resized, shift, (side, side))


def _multiple(length: float, patch: int) -> int:
    # Python's round, half to even, as the network's own code has it.
    return max(patch, round(length / patch) * patch)


def fitted_picture(rgba: Bytes, frame: Frame, background: int) -> Bytes:
    """(H, W, 3) colours of a photo (h, w, 3 or 4) in a frame, over a plain grey, also as padding.

    Bicubic, in whole levels, as Pillow does it.
    """
    from PIL import Image

    image = Image.fromarray(rgba)
    if rgba.shape[2] == 4:
        ground = Image.new("RGBA", image.size, (background, background, background, 255))
        image = Image.alpha_composite(ground, image).convert("RGB")
    resized = np.asarray(image.resize(frame.resized, Image.Resampling.BICUBIC))
    return frame.placed(resized, background)
