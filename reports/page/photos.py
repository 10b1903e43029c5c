"""Photos as a page carries them: WebP with transparency, small enough for a screen."""

from __future__ import annotations

import io
from collections.abc import Sequence

from PIL import Image

from harness.core.arrays import Bytes
from harness.core.cameras.camera import Camera

#: The longer side of a photo on the page, in pixels; no photo is made larger.
MOST_PHOTO_PIXELS = 960
_THUMBNAIL_PIXELS = 192
_QUALITY = 86


def webp(rgba: Bytes, size: tuple[int, int]) -> bytes:
    """A photo (H, W, 4) as a WebP file of a size (width, height); equal pixels give equal bytes."""
    picture = Image.fromarray(rgba)
    if picture.size != size:
        # Premultiplied, so that the colour behind transparent pixels does not bleed into edges.
        picture = picture.convert("RGBa").resize(size, Image.Resampling.BOX).convert("RGBA")
    stream = io.BytesIO()
    picture.save(stream, format="WEBP", quality=_QUALITY, alpha_quality=90, method=3)
    return stream.getvalue()


def photo_camera(camera: Camera) -> Camera:
    """The camera of the photo as the page shows it."""
    return camera.resized(*_fitted((camera.width, camera.height), MOST_PHOTO_PIXELS))


def thumbnail(rgba: Bytes) -> bytes:
    """A small WebP of a photo."""
    height, width = rgba.shape[:2]
    return webp(rgba, _fitted((width, height), _THUMBNAIL_PIXELS))


def _fitted(size: Sequence[int], most: int) -> tuple[int, int]:
    scale = min(1.0, most / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
