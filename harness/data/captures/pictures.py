"""Photos as they come from cameras and programs: any usual format, turned as their file says."""

from __future__ import annotations

import math
import re
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from harness.core.arrays import Bytes, Floats, Mask, Singles
from harness.core.cameras.camera import Camera
from harness.core.errors import DataError, did_you_mean
from harness.data.captures.lens import Lens, undistortion_map
from harness.data.captures.views import ForeignView
from harness.geometry.images import MOST_PIXELS, resampled

if TYPE_CHECKING:
    from PIL.Image import Image

Result = TypeVar("Result")

PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp")
_FORMATS = ("JPEG", "PNG", "WEBP", "TIFF", "BMP")
#: EXIF's facts of the camera, and among them the focal length as on film, which is 36 mm wide.
_CAMERA_FACTS, _FOCAL_35MM, _FILM_MM = 0x8769, 41989, 36.0
#: EXIF's tag of how the picture is turned, and its values as quarter turns against the clock.
_ORIENTATION = 274
_QUARTER_TURNS = {1: 0, 3: 2, 6: 3, 8: 1}
#: A photo whose alpha is clear in less than this share has no person cut out: a rounded corner.
_LEAST_CLEAR = 0.02
#: Sides of pictures and of cameras are of one shape up to this share.
_SAME_SHAPE = 0.01
_ROWS_AT_ONCE = 256


@dataclass(frozen=True, slots=True, eq=False)
class TakenPhoto:
    """A photo without its lens, and the pinhole camera that took it.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB.
        alpha: (H, W) uint8 coverage by the subject; None where the file does not tell it.
        shown: (H, W) uint8 255 where the lens shows that direction; less beyond its picture.
        camera: Of exactly these pixels.
    """

    rgb: Bytes
    alpha: Bytes | None
    shown: Bytes
    camera: Camera

    def resized(self, longest_px: int) -> TakenPhoto:
        """The photo with at most so many pixels along its longer side."""
        share = longest_px / max(self.camera.size)
        if share >= 1:
            return self
        size = (max(1, round(share * self.camera.width)), max(1, round(share * self.camera.height)))
        weight = 255.0 if self.alpha is None else np.maximum(self.alpha, 1e-3)[..., None]
        rgb = resampled(self.rgb * np.asarray(weight, dtype=np.float64), size, "box")
        if self.alpha is None:
            return TakenPhoto(_bytes(rgb / 255.0), None, self._small(self.shown, size),
                              self.camera.resized(*size))  # fmt: skip
        alpha = resampled(np.maximum(self.alpha, 1e-3), size, "box")
        colour = rgb / alpha[..., None]
        return TakenPhoto(_bytes(colour), _bytes(alpha), self._small(self.shown, size),
                          self.camera.resized(*size))  # fmt: skip

    @staticmethod
    def _small(picture: Bytes, size: tuple[int, int]) -> Bytes:
        return _bytes(resampled(picture.astype(np.float64), size, "box"))

    def turned(self, quarters: int) -> TakenPhoto:
        """The photo turned by quarter turns against the clock, with its camera."""
        if quarters % 4 == 0:
            return self
        alpha = None if self.alpha is None else np.ascontiguousarray(np.rot90(self.alpha, quarters))
        return TakenPhoto(
            np.ascontiguousarray(np.rot90(self.rgb, quarters)),
            alpha,
            np.ascontiguousarray(np.rot90(self.shown, quarters)),
            _turned_camera(self.camera, quarters),
        )


def photo_folder(folder: Path) -> Path:
    """The folder itself, or its ``images`` where the photos lie there.

    Raises:
        DataError: no such folder.
    """
    if not folder.is_dir():
        raise DataError(f"no folder at {folder}")
    below = folder / "images"
    here = any(path.suffix.lower() in PICTURE_SUFFIXES for path in folder.iterdir())
    return below if below.is_dir() and not here else folder


def find_photos(folder: Path) -> tuple[Path, ...]:
    """The photos in a folder, in the natural order of their names (2 before 10).

    Raises:
        DataError: no such folder, or no photo in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder at {folder}")
    found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURE_SUFFIXES]
    if not found:
        raise DataError(f"{folder} holds no photos", expected=", ".join(PICTURE_SUFFIXES))
    return tuple(sorted(found, key=_natural))


def _natural(path: Path) -> tuple[list[tuple[int, int | str]], str]:
    words = re.findall(r"\d+|\D+", path.stem)
    return [(0, int(word)) if word.isdigit() else (1, word) for word in words], path.suffix


def find_photo(folder: Path, base: Path, name: str) -> Path:
    """The photo of a name in a camera file: below the folder of photos or beside the file.

    Args:
        folder: Of the photos.
        base: Folder of the camera file.
        name: As the file has it, with or without an extension.

    Raises:
        DataError: there is none.
    """
    for candidate in _candidates(folder, base, name):
        if candidate.is_file():
            return candidate
    names = [path.name for path in folder.iterdir() if path.suffix.lower() in PICTURE_SUFFIXES]
    raise DataError(
        f"the camera file names the photo '{name}', which is not in {folder}",
        hint=did_you_mean(Path(name).name, names),
    )


def _candidates(folder: Path, base: Path, name: str) -> Iterator[Path]:
    places = (base / name, folder / name, folder / Path(name).name)
    yield from places
    for place in places:
        for suffix in PICTURE_SUFFIXES:
            yield place.with_name(place.name + suffix)
            yield place.with_suffix(suffix)


def find_mask(folder: Path, photo: Path) -> Path | None:
    """A photo's mask in a folder of masks: of the same name, or with its extension added.

    The folder may be that of the photos; no photo is its own mask.
    """
    names = [photo.name, f"{photo.name}.png", f"{photo.stem}.png", f"{photo.stem}_mask.png",
             *(f"{photo.stem}{suffix}" for suffix in PICTURE_SUFFIXES)]  # fmt: skip
    found = (folder / name for name in names if (folder / name).is_file())
    return next((path for path in found if not path.samefile(photo)), None)


def read_photo(path: Path, view: ForeignView, mask: Path | None = None) -> TakenPhoto:
    """A photo on the pixels of a pinhole: turned as its file says, its lens undone.

    A photo of another size than its camera, but of the same shape, takes the camera with it.

    Args:
        path: The photo.
        view: Its camera and lens.
        mask: Its mask's file, which counts more than the photo's own alpha. White or opaque is the
            subject: an alpha channel that varies counts, else brightness.

    Raises:
        DataError: not a complete picture, or of another shape than its camera.
    """
    rgba, quarters = _opened(path)
    if mask is not None:
        rgba = np.dstack([rgba[..., :3], _coverage(mask, (rgba.shape[1], rgba.shape[0]))])
    stored = (rgba.shape[1], rgba.shape[0])
    if not _same_shape(stored, view.camera.size):
        if quarters % 2 == 0 or not _same_shape(stored[::-1], view.camera.size):
            raise _other_shape(path, stored, view.camera)
        # The camera is of the picture as viewers show it, not as the file stores it.
        rgba, quarters = np.rot90(rgba, quarters), 0
    camera = view.camera.resized(rgba.shape[1], rgba.shape[0])
    has_alpha = mask is not None or float((rgba[..., 3] < 128).mean()) > _LEAST_CLEAR
    return _pinhole(rgba, camera, view.lens, has_alpha=has_alpha).turned(quarters)


def _other_shape(path: Path, size: tuple[int, int], camera: Camera) -> DataError:
    return DataError(
        f"{path} is of another shape than its camera",
        expected=f"{camera.width} x {camera.height} pixels, or as many times more or fewer",
        got=f"{size[0]} x {size[1]}",
        hint="Give the photos that the cameras were computed from, not cropped",
    )


def _coverage(path: Path, size: tuple[int, int]) -> Bytes:
    """(H, W) uint8 of a mask file on the pixels of a photo of ``size`` (width, height)."""
    rgba, _ = _opened(path)
    values = rgba[..., 3] if (rgba[..., 3] < 255).any() else rgba[..., :3].max(axis=2)
    own = (values.shape[1], values.shape[0])
    if not _same_shape(own, size):
        raise DataError(
            f"{path} is of another shape than its photo",
            expected=f"{size[0]} x {size[1]} pixels, or as many times more or fewer",
            got=f"{own[0]} x {own[1]}",
        )
    return values if own == size else _bytes(resampled(values.astype(float), size, "bilinear"))


@dataclass(frozen=True, slots=True)
class PictureFacts:
    """What a picture's file says of it without its pixels.

    Attributes:
        size: (width, height) as stored.
        quarters: Quarter turns against the clock that show it upright.
        field_deg: Field of view along the longer side, degrees; 0 where the file does not tell.
    """

    size: tuple[int, int]
    quarters: int
    field_deg: float


def picture_facts(path: Path) -> PictureFacts:
    """Size, orientation and field of view as a picture's file tells them.

    Raises:
        DataError: no such file, or no picture.
    """

    def facts(image: Image) -> PictureFacts:
        exif = image.getexif()
        focal_mm = float(exif.get_ifd(_CAMERA_FACTS).get(_FOCAL_35MM) or 0.0)
        field = 2 * math.degrees(math.atan(_FILM_MM / 2 / focal_mm)) if focal_mm > 0 else 0.0
        quarters = _QUARTER_TURNS.get(exif.get(_ORIENTATION, 1), 0)
        return PictureFacts(image.size, quarters, field)

    return _read(path, facts)


def _opened(path: Path) -> tuple[Bytes, int]:
    """(H, W, 4) pixels as stored, and the quarter turns against the clock that show it upright."""

    def content(image: Image) -> tuple[Bytes, int]:
        if image.width * image.height > MOST_PIXELS:
            raise DataError(
                f"{path} has too many pixels",
                expected=f"at most {MOST_PIXELS}",
                got=f"{image.width} x {image.height}",
                hint="Make the photos smaller",
            )
        quarters = _QUARTER_TURNS.get(image.getexif().get(_ORIENTATION, 1), 0)
        return np.asarray(image.convert("RGBA")), quarters

    return _read(path, content)


def _read(path: Path, use: Callable[[Image], Result]) -> Result:
    """What ``use`` makes of an opened picture."""
    from PIL import Image

    try:
        with Image.open(path, formats=_FORMATS) as image:
            return use(image)
    except FileNotFoundError as error:
        raise DataError(f"no photo at {path}") from error
    # Pillow's decoders raise whatever a damaged file leads them to.
    except (ArithmeticError, LookupError, OSError, RuntimeError, SyntaxError, TypeError, ValueError,
            struct.error, zlib.error, Image.DecompressionBombError) as error:  # fmt: skip
        raise DataError(
            f"{path} is not a complete picture",
            expected=", ".join(_FORMATS),
            got=f"{type(error).__name__}: {error}",
        ) from error


def _same_shape(size: Sequence[int], other: Sequence[int]) -> bool:
    return abs(size[0] * other[1] / (size[1] * other[0]) - 1) < _SAME_SHAPE


def _pinhole(rgba: Bytes, camera: Camera, lens: Lens, *, has_alpha: bool) -> TakenPhoto:
    """A photo on the pixels of its pinhole."""
    shown = np.full(rgba.shape[:2], 255, dtype=np.uint8)
    if not lens.bends:
        alpha = np.ascontiguousarray(rgba[..., 3]) if has_alpha else None
        return TakenPhoto(np.ascontiguousarray(rgba[..., :3]), alpha, shown, camera)
    places, seen = undistortion_map(camera, lens)
    weight = rgba[..., 3].astype(np.float32) if has_alpha else np.float32(255.0)
    # Colours count by their coverage, so that what lies behind a cut-out does not bleed in.
    layers = [rgba[..., channel] * (weight / np.float32(255.0)) for channel in range(3)]
    if has_alpha:
        layers.append(rgba[..., 3].astype(np.float32))
    found = np.stack([_sampled(layer, places, seen) for layer in layers], axis=-1)
    inside = _bytes(_sampled(shown.astype(np.float32), places, seen))
    if not has_alpha:
        return TakenPhoto(_bytes(found), None, inside, camera)
    alpha = found[..., 3]
    colour = found[..., :3] * 255.0 / np.maximum(alpha, 1e-3)[..., None]
    return TakenPhoto(_bytes(colour), _bytes(alpha), inside, camera)


def _sampled(layer: Singles, places: Floats, seen: Mask) -> Floats:
    """(H, W) values of a layer at pixel coordinates, 0 beyond it."""
    from scipy.ndimage import map_coordinates

    rows = [
        map_coordinates(
            layer,
            [places[start : start + _ROWS_AT_ONCE, :, 1] - 0.5,
             places[start : start + _ROWS_AT_ONCE, :, 0] - 0.5],
            order=1, mode="constant",
        )
        for start in range(0, len(places), _ROWS_AT_ONCE)
    ]  # fmt: skip
    return np.where(seen, np.concatenate(rows), 0.0)


def _turned_camera(camera: Camera, quarters: int) -> Camera:
    """The camera of a picture turned by quarter turns against the clock."""
    for _ in range(quarters % 4):
        width, height = camera.size
        (fx, _, cx), (_, fy, cy) = camera.K[:2]
        # A pixel at (x, y) goes to (y, width - x).
        K = [[fy, 0.0, cy], [0.0, fx, width - cx], [0.0, 0.0, 1.0]]
        turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        pose = camera.turned(turn).world_to_camera
        camera = Camera(np.array(K), pose, height, width)
    return camera


def _bytes(values: Floats) -> Bytes:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)
