"""Pictures on disk: strict reading, atomic writing, compositing."""

from __future__ import annotations

import io
import os
import struct
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.core.arrays import Bytes, Floats
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path

if TYPE_CHECKING:
    from PIL.Image import Image

Result = TypeVar("Result")
Number = TypeVar("Number", bound=np.generic)

#: Larger pictures are refused: the largest textures of scans have 8192 x 8192 pixels.
MOST_PIXELS = 8192 * 8192
#: Formats that decode in this process; Pillow gives others, such as EPS, to other programs.
_TEXTURE_FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "TGA")

#: Decoded photos stay in memory up to this many bytes: 32 of the paper's size.
_KEPT_BYTES = 256 * 2**20
_WHITE_16 = 65535
#: The last chunk of every complete PNG; Pillow itself does not miss it.
_PNG_END = b"IEND\xaeB`\x82"


def load_rgba(path: str | Path, size: tuple[int, int] | None = None) -> Bytes:
    """(H, W, 4) uint8 of an RGBA PNG: sRGB colour (not premultiplied) and coverage.

    Args:
        path: The PNG.
        size: (width, height) that it must have.

    Raises:
        DataError: no such file, not a PNG, truncated or damaged, another mode or size.
    """
    rgba = _photos(PictureFile.of(Path(path)))
    height, width = rgba.shape[:2]
    if size is not None and (width, height) != tuple(size):
        raise DataError(
            f"{path} is of another size than its camera",
            expected=f"{size[0]} x {size[1]} pixels",
            got=f"{width} x {height}",
            hint="Render the capture again, or resize the camera with the picture",
        )
    return rgba


class PictureFile(NamedTuple):
    """A file as it is on disk now: what is kept under it holds as long as the file does."""

    path: Path
    modified_ns: int
    size_bytes: int

    @classmethod
    def of(cls, path: Path) -> PictureFile:
        """The file at a path.

        Raises:
            DataError: there is none.
        """
        if not path.is_file():
            raise DataError(f"no image at {path}")
        stamp = path.stat()
        return cls(path, stamp.st_mtime_ns, stamp.st_size)


class _Kept:
    """Decoded photos by their files, the least recently used dropped first."""

    def __init__(self) -> None:
        self._pixels: dict[PictureFile, Bytes] = {}

    def __call__(self, file: PictureFile) -> Bytes:
        """The photo's pixels; decoded once, because several stages of a method want them."""
        pixels = self._pixels.pop(file, None)
        if pixels is None:
            pixels = _decoded(file.path)
        self._pixels[file] = pixels
        while len(self._pixels) > 1 and sum(p.nbytes for p in self._pixels.values()) > _KEPT_BYTES:
            del self._pixels[next(iter(self._pixels))]
        return pixels


_photos = _Kept()


def _decoded(path: Path) -> Bytes:
    """(H, W, 4) pixels of an RGBA PNG, read-only."""
    image = _open_png(path)
    if image.mode != "RGBA":
        raise DataError(
            f"{path} has no alpha channel to tell subject from background",
            expected="an RGBA PNG",
            got=f"mode {image.mode}",
        )
    pixels = np.asarray(image)
    pixels.flags.writeable = False
    return pixels


def load_mask(path: str | Path, size: tuple[int, int] | None = None) -> Floats:
    """(H, W) coverage in [0, 1] of an RGBA PNG: its alpha. Raises as ``load_rgba``."""
    return load_rgba(path, size)[..., 3] / 255.0


def load_rgb(path: Path, content: bytes | None = None) -> Bytes:
    """(H, W, 3) uint8 sRGB of a picture such as a texture (JPEG, PNG, TIFF, WebP, BMP, TGA).

    Of any kind: grey, palette, CMYK, 16 bits. Alpha is dropped. ``content`` is the picture where it
    is a part of the file.

    Raises:
        DataError: no such file, not a complete picture, or one of more than ``MOST_PIXELS``.
    """
    return read_picture(
        path, _TEXTURE_FORMATS, lambda image: np.asarray(eight_bit(image, "RGB")), content
    )


def eight_bit(image: Image, mode: Literal["L", "RGB", "RGBA"]) -> Image:
    """A picture of any kind with eight bits a channel: 16 bits are scaled, where Pillow clips them.

    Raises:
        DataError: floats, or whole numbers of more than 16 bits, whose white is not known.
    """
    from PIL import Image as Pillow

    if image.mode[0] not in "IF":
        return image.convert(mode)
    values = np.asarray(image)
    if image.mode == "F" or values.min() < 0 or values.max() > _WHITE_16:
        raise DataError(
            f"{getattr(image, 'filename', 'a picture')} is of a kind without a known white",
            expected="8 or 16 bits a channel",
            got=f"mode {image.mode}, {values.min():g} to {values.max():g}",
            hint="Save it with 8 bits a channel",
        )
    scaled = np.round(values.astype(np.float32) * (255 / _WHITE_16))
    return Pillow.fromarray(scaled.astype(np.uint8)).convert(mode)


def check_picture(path: Path) -> str:
    """Pillow's mode of a picture; refused, by its header alone, as ``load_rgb`` would refuse it.

    For programs of others that read the picture themselves. Raises as ``load_rgb``.
    """
    return read_picture(path, _TEXTURE_FORMATS, lambda image: image.mode)


def _open_png(path: Path) -> Image:
    def loaded(image: Image) -> Image:
        image.load()
        return image

    # Checks every chunk's checksum, which decoding does not, and leaves the file unusable.
    read_picture(path, ("PNG",), lambda image: image.verify())
    _check_end(path)
    return read_picture(path, ("PNG",), loaded)


def _check_end(path: Path) -> None:
    with path.open("rb") as stream:
        stream.seek(-len(_PNG_END), os.SEEK_END)
        if stream.read() != _PNG_END:
            raise _incomplete(path, ("PNG",), "the file ends before its last chunk")


def read_picture(
    path: Path,
    formats: tuple[str, ...],
    use: Callable[[Image], Result],
    content: bytes | None = None,
) -> Result:
    """What ``use`` makes of an opened picture whose size, as its header tells it, is possible."""
    from PIL import Image

    # Pillow warns of large pictures on its own: here they are refused instead.
    warnings.simplefilter("error", Image.DecompressionBombWarning)
    if not path.is_file():
        raise DataError(f"no image at {path}")
    try:
        source = path if content is None else io.BytesIO(content)
        with Image.open(source, formats=formats) as image:
            if image.width * image.height > MOST_PIXELS:
                raise _too_large(path, f"{image.width} x {image.height}")
            return use(image)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise _too_large(path, "many more") from error
    # Pillow's decoders raise whatever a damaged file leads them to.
    except (ArithmeticError, LookupError, OSError, RuntimeError, SyntaxError, TypeError,
            ValueError, struct.error, zlib.error) as error:  # fmt: skip
        raise _incomplete(path, formats, str(error)) from error


def _incomplete(path: Path, formats: tuple[str, ...], got: str) -> DataError:
    return DataError(
        f"{path} is not a complete {'PNG' if formats == ('PNG',) else 'image'}",
        expected=", ".join(formats),
        got=got,
        hint="It may be truncated: get or make it again",
    )


def _too_large(path: Path, got: str) -> DataError:
    return DataError(
        f"{path} has more pixels than any picture used here",
        expected=f"at most {MOST_PIXELS} pixels, as 8192 x 8192",
        got=got,
        hint="Make it smaller: no measurement needs so many",
    )


def packed_normals(normals: Floats) -> NDArray[np.int8]:
    """Normals (..., 3) in eight bits a component, 127 times as long: good to half a degree."""
    return np.round(127.0 * normals).astype(np.int8)


def unit_normals(vectors: Floats) -> Floats:
    """(..., 3) vectors at unit length; nothing stays nothing."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def normal_colours(normals: Floats) -> Floats:
    """(H, W, 3) in [0, 1]: the usual colours of a normal map, white where there is none."""
    there = normals.any(axis=2, keepdims=True)
    return np.where(there, (normals + 1.0) / 2.0, 1.0)


def save_png(path: Path, image: ArrayLike) -> None:
    """Write an image (H, W), (H, W, 3) or (H, W, 4) atomically as PNG.

    Args:
        path: Ends in ``.png``.
        image: uint8 as it is; bool becomes 0 and 255. Floats are refused, not guessed at.

    Raises:
        DataError: another type or shape, or the disk refuses.
    """
    from PIL import Image

    array = np.asarray(image)
    if array.dtype == bool:
        array = array.astype(np.uint8) * 255
    shaped = array.ndim == 2 or (array.ndim == 3 and array.shape[2] in (3, 4))
    if array.dtype != np.uint8 or not shaped or array.size == 0:
        raise DataError(
            f"cannot write {path}",
            expected="uint8 or bool of shape (H, W), (H, W, 3) or (H, W, 4)",
            got=f"{array.dtype} {array.shape}",
        )
    with atomic_path(path) as temporary:
        Image.fromarray(array).save(temporary, format="PNG", compress_level=4)


def composite(rgba: Bytes, background: ArrayLike = (0.0, 0.0, 0.0)) -> Floats:
    """(H, W, 3) in [0, 1]: an RGBA image over a plain colour, blended as displays do (in sRGB).

    Args:
        rgba: (H, W, 4) uint8, colour not premultiplied.
        background: (3,) sRGB colour in [0, 1].
    """
    colour = rgba[..., :3] / 255.0
    alpha = rgba[..., 3:] / 255.0
    return colour * alpha + np.asarray(background, dtype=np.float64) * (1.0 - alpha)


def resampled(image: Floats, size: tuple[int, int], kernel: Literal["box", "bilinear"]) -> Floats:
    """An image (H, W) or (H, W, C) at another size (width, height), in float32's precision.

    Made smaller, each new pixel is the mean of all that it covers: ``box`` of those alone,
    ``bilinear`` weighted, and a little beyond.
    """
    from PIL import Image

    filters = {"box": Image.Resampling.BOX, "bilinear": Image.Resampling.BILINEAR}
    channels = [
        np.asarray(Image.fromarray(channel).resize(size, filters[kernel]), dtype=np.float64)
        for channel in np.moveaxis(np.atleast_3d(image).astype(np.float32), -1, 0)
    ]
    return np.stack(channels, axis=-1) if image.ndim == 3 else channels[0]


def sampled(image: NDArray[Number], pixels: Floats) -> NDArray[Number]:
    """(N,) values of an image (H, W) at pixel coordinates (N, 2), bilinear; the border's beyond it.

    The centre of the top-left pixel is (0.5, 0.5).
    """
    from scipy.ndimage import map_coordinates

    values = map_coordinates(image, pixels[:, ::-1].T - 0.5, order=1, mode="nearest")
    return np.asarray(values, dtype=image.dtype)


def linear_from_srgb(colour: ArrayLike) -> Floats:
    """Linear intensities of sRGB values in [0, 1] (IEC 61966-2-1)."""
    colour = np.asarray(colour, dtype=np.float64)
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(intensity: ArrayLike) -> Floats:
    """SRGB values of linear intensities in [0, 1] (IEC 61966-2-1)."""
    intensity = np.asarray(intensity, dtype=np.float64)
    bright = 1.055 * np.maximum(intensity, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(intensity <= 0.0031308, intensity * 12.92, bright)
