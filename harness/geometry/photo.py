"""A photo owns its camera: pixels and camera are opened, cropped and resized together.

``open_photo`` decodes each file once per process. A photo keeps the file's own pixels; who works
on other pixels takes a ``Picture`` of it:

    photo = open_photo(capture, 0)
    window = photo.outline.box.square(fill=0.9)
    picture = photo.cropped(window).resized(512, 512)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.core.arrays import Bytes, Floats, Mask
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.images import composite, linear_from_srgb, load_rgba, resampled
from harness.geometry.outline import Outline
from harness.geometry.raycast import Hits
from harness.geometry.window import Window

#: Backgrounds, sRGB.
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A view at a working size: floating-point colours on the pixels of its camera.

    Attributes:
        camera: Full perspective, of exactly these pixels.
        rgb: (H, W, 3) sRGB in [0, 1] over black, so that half-covered pixels are darker.
        coverage: (H, W) share of each pixel that the subject covers, 0 to 1.
    """

    camera: Camera
    rgb: Floats
    coverage: Floats

    @property
    def mask(self) -> Mask:
        """(H, W) where at least half of the pixel is subject."""
        return self.coverage >= 0.5


@dataclass(frozen=True, eq=False)
class Photo:
    """One view of a capture as its file has it, or a window of it.

    Attributes:
        rgba: (H, W, 4) uint8: sRGB colour, not premultiplied, and coverage; not to be written to.
        camera: Full perspective, of exactly these pixels.
        source: The file.
    """

    rgba: Bytes
    camera: Camera
    source: Path

    @cached_property
    def mask(self) -> Mask:
        """(H, W) where at least half of the pixel is subject."""
        return self.rgba[..., 3] >= 128

    @property
    def coverage(self) -> Floats:
        """(H, W) share of each pixel that the subject covers, 0 to 1; computed at each call."""
        return self.rgba[..., 3] / 255.0

    @property
    def outline(self) -> Outline:
        """The subject's silhouette; made at each call, and what it computes is kept with it."""
        return Outline(self.camera, self.coverage)

    def over(self, background: ArrayLike = BLACK) -> Floats:
        """(H, W, 3) in [0, 1]: the subject over a plain sRGB colour (3,) in [0, 1]."""
        there = self.rgba[..., 3] > 0
        picture = np.empty((*there.shape, 3))
        picture[:] = background
        # Most of a photo is background.
        picture[there] = composite(self.rgba[there], background)
        return picture

    def cropped(self, window: Window) -> Photo:
        """A window of the photo; nothing is shown where it reaches outside."""
        return replace(self, rgba=window.cut(self.rgba), camera=window.camera(self.camera))

    def resized(
        self, width: int, height: int, kernel: Literal["box", "bilinear"] = "bilinear"
    ) -> Picture:
        """The photo over black on other pixels, in float32's precision."""
        size = (width, height)
        return Picture(
            camera=self.camera.resized(width, height),
            rgb=resampled(self.over(BLACK), size, kernel),
            coverage=resampled(self.coverage, size, kernel),
        )


def open_photo(capture: Capture, view: int) -> Photo:
    """A view of a capture, by its index; its file is decoded once per process.

    Raises:
        DataError: no such file, not a complete RGBA PNG, or of another size than its camera.
    """
    camera, path = capture.cameras[view], capture.image_path(view)
    return Photo(load_rgba(path, camera.size), camera, path)


def linear_texture(texture: NDArray[np.uint8]) -> Floats:
    """(H, W, 3) linear intensities of an sRGB texture (H, W, 3) uint8."""
    return linear_from_srgb(np.arange(256) / 255.0)[texture]


def texture_at(hits: Hits, mesh: Mesh, texture: Floats) -> Floats:
    """(H, W, 3) colour at every hit, bilinear, repeating; 0 where nothing is met.

    Args:
        hits: Where rays meet ``mesh``.
        mesh: With texture coordinates.
        texture: (h, w, 3), in the units that are wanted; see ``linear_texture``.
    """
    from scipy.ndimage import map_coordinates

    assert mesh.uv is not None
    assert mesh.face_uv is not None
    height, width, _ = texture.shape
    u, v = np.moveaxis(hits.interpolate(mesh.uv, mesh.face_uv)[hits.mask], 1, 0)
    # The texture's v grows upward and texel centres lie at half steps.
    where = np.stack([(1.0 - v) * height - 0.5, u * width - 0.5])
    colour = np.zeros((*hits.mask.shape, 3))
    for channel in range(3):
        colour[hits.mask, channel] = map_coordinates(
            texture[..., channel], where, order=1, mode="grid-wrap"
        )
    return colour
