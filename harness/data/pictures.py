"""Photos as they come from cameras and programs: any usual format, turned as their file says."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Bytes, Floats, Mask, Singles
from harness.core.camera import Camera
from harness.core.errors import DataError
from harness.core.files.names import inside
from harness.data.lens import ForeignView, Lens, undistortion_map
from harness.geometry.images import eight_bit, read_picture, resampled

if TYPE_CHECKING:
    from PIL.Image import Image


Result = TypeVar("Result")
Pixel = TypeVar("Pixel", bound=np.generic)

PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp")
_FORMATS = ("JPEG", "PNG", "WEBP", "TIFF", "BMP")
#: EXIF's facts of the camera, and among them the focal length as on film, which is 36 mm wide.
_CAMERA_FACTS, _FOCAL_35MM, _FILM_MM = 0x8769, 41989, 36.0
#: EXIF's tag of how the picture is turned.
_ORIENTATION = 274
#: A photo whose alpha is clear in less than this share has no person cut out: a rounded corner.
_LEAST_CLEAR = 0.02
#: Sides of pictures and of cameras are of one shape up to this share.
_SAME_SHAPE = 0.01
#: A mask's inside is about white. From this share of white on it is brightened, as one of 0 to 127
#: is; below it, it has numbers of people or parts. Its outside is about black.
_FULL, _DIM, _DARK = 0.6, 0.25, 0.1
_ROWS_AT_ONCE = 256


@dataclass(frozen=True, slots=True)
class Turn:
    """How a picture as its file stores it becomes the one that viewers show.

    Attributes:
        mirrored: Whether left and right are exchanged first.
        quarters: Quarter turns against the clock.
    """

    mirrored: bool = False
    quarters: int = 0

    @property
    def moves(self) -> bool:
        """Whether both are different pictures."""
        return self != Turn()

    def shown(self, pixels: NDArray[Pixel]) -> NDArray[Pixel]:
        """The picture as viewers show it, of the stored one (H, W) or (H, W, C)."""
        return np.rot90(pixels[:, ::-1] if self.mirrored else pixels, self.quarters)

    def stored(self, pixels: NDArray[Pixel]) -> NDArray[Pixel]:
        """The stored picture of the one that viewers show."""
        back = np.rot90(pixels, -self.quarters)
        return back[:, ::-1] if self.mirrored else back

    def size(self, size: tuple[int, int]) -> tuple[int, int]:
        """(width, height) of one of both, of the other's."""
        width, height = size
        return (height, width) if self.quarters % 2 else size


#: By EXIF's number.
_TURNS = {1: Turn(), 2: Turn(True), 3: Turn(False, 2), 4: Turn(True, 2), 5: Turn(True, 1),
          6: Turn(False, 3), 7: Turn(True, 3), 8: Turn(False, 1)}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Reading:
    """Of which form of a photo that its file turns the camera and the mask are.

    Attributes:
        camera_shown: Whether the camera is of the picture as viewers show it, not as it is stored.
        mask_shown: Whether the mask is.
    """

    camera_shown: bool = False
    mask_shown: bool = False


READINGS = tuple(Reading(camera, mask) for camera in (False, True) for mask in (False, True))


@dataclass(frozen=True, slots=True, eq=False)
class TakenPhoto:
    """A photo without its lens, and the pinhole camera that took it.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB.
        alpha: (H, W) uint8 coverage by the subject; None where the file does not tell it.
        shown: (H, W) uint8 255 where the lens shows that direction; less beyond its picture.
        camera: Of exactly these pixels.
        inverted: Whether the mask's file was white around the subject.
    """

    rgb: Bytes
    alpha: Bytes | None
    shown: Bytes
    camera: Camera
    inverted: bool = False

    def resized(self, longest_px: int) -> TakenPhoto:
        """The photo with at most so many pixels along its longer side."""
        share = longest_px / max(self.camera.size)
        if share >= 1:
            return self
        size = (max(1, round(share * self.camera.width)), max(1, round(share * self.camera.height)))
        weight = 255.0 if self.alpha is None else np.maximum(self.alpha, 1e-3)[..., None]
        rgb = resampled(self.rgb * np.asarray(weight, dtype=np.float64), size, "box")
        shown = _bytes(resampled(self.shown.astype(np.float64), size, "box"))
        small = replace(self, shown=shown, camera=self.camera.resized(*size))
        if self.alpha is None:
            return replace(small, rgb=_bytes(rgb / 255.0))
        alpha = resampled(np.maximum(self.alpha, 1e-3), size, "box")
        return replace(small, rgb=_bytes(rgb / alpha[..., None]), alpha=_bytes(alpha))

    def turned(self, quarters: int) -> TakenPhoto:
        """The photo turned by quarter turns against the clock, with its camera."""
        if quarters % 4 == 0:
            return self
        rgb, shown = (np.ascontiguousarray(np.rot90(p, quarters)) for p in (self.rgb, self.shown))
        alpha = None if self.alpha is None else np.ascontiguousarray(np.rot90(self.alpha, quarters))
        return replace(self, rgb=rgb, alpha=alpha, shown=shown,
                       camera=_turned_camera(self.camera, quarters))  # fmt: skip


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
        DataError: no such folder, no photo in it, or a link out of it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder at {folder}")
    found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURE_SUFFIXES]
    for path in found:
        inside(folder, path, folder)
    if not found:
        raise DataError(f"{folder} holds no photos", expected=", ".join(PICTURE_SUFFIXES))
    return tuple(sorted(found, key=_natural))


def _natural(path: Path) -> tuple[list[tuple[int, int | str]], str]:
    words = re.findall(r"\d+|\D+", path.stem)
    return [(0, int(word)) if word.isdigit() else (1, word) for word in words], path.suffix


@dataclass(frozen=True, slots=True)
class NamedPictures:
    """Pictures that a camera file names: each by the path that stands there, and by no other.

    Attributes:
        source: The camera file, or the folder of a COLMAP model.
        named: Folder that the user named for photos.
    """

    source: Path
    named: Path

    def find(self, name: str) -> Path | None:
        """The picture of a path, with or without an extension; None where there is none.

        Raises:
            DataError: it lies outside the folders that the user named.
        """
        places = list(self._places(name))
        folders = [self.named] if self.source.is_dir() else [self.named, self.source.parent]
        for path in (*places, *(other for place in places for other in _with_suffixes(place))):
            if path.is_file():
                return inside(self.source, path, *folders)
        return None

    def _places(self, name: str) -> Iterator[Path]:
        folder = photo_folder(self.named)
        for text in dict.fromkeys((name, name.replace("\\", "/"))):
            if not self.source.is_dir():  # a COLMAP model's names count from the photos' folder
                yield self.source.parent / text
            yield folder / text
            # The folder of the photos may itself be the first part of the path, or the first ones.
            parts = [part for part in PurePosixPath(text).parts if part != ".."]
            for count in range(1, len(parts)):
                if tuple(parts[:count]) == folder.parts[-count:]:
                    yield folder.joinpath(*parts[count:])


def _with_suffixes(path: Path) -> Iterator[Path]:
    for suffix in PICTURE_SUFFIXES if path.name else ():
        yield path.with_name(path.name + suffix)
        if path.suffix.lower() in PICTURE_SUFFIXES:
            yield path.with_suffix(suffix)


def find_mask(folder: Path, photo: Path) -> Path | None:
    """A photo's mask in a folder of masks: of the same name, or with its extension added.

    The folder may be that of the photos; no photo is its own mask.
    """
    names = [photo.name, f"{photo.name}.png", f"{photo.stem}.png", f"{photo.stem}_mask.png",
             *(f"{photo.stem}{suffix}" for suffix in PICTURE_SUFFIXES)]  # fmt: skip
    found = (folder / name for name in names if (folder / name).is_file())
    return next((path for path in found if not path.samefile(photo)), None)


def fitting_readings(path: Path, view: ForeignView, mask: Path | None) -> tuple[Reading, ...]:
    """The readings of a photo under which its shape is that of its camera and of its mask.

    Raises:
        DataError: a file that is no picture, or a shape that fits none.
    """
    facts = picture_facts(path)
    sizes = {False: facts.size, True: facts.turn.size(facts.size)}
    cameras = [shown for shown in sizes if _same_shape(sizes[shown], view.camera.size)]
    if not cameras:
        raise _other_shape(path, "camera", view.camera.size, facts.size)
    if mask is None:
        return tuple(reading for reading in READINGS if reading.camera_shown in cameras)
    own = picture_facts(mask)
    size = own.turn.size(own.size)
    # A mask that is itself turned by its file is of what viewers show.
    masks = [s for s in sizes if _same_shape(size, sizes[s]) and (s or not own.turn.moves)]
    if not masks:
        raise _other_shape(mask, "photo", facts.size, own.size)
    return tuple(r for r in READINGS if r.camera_shown in cameras and r.mask_shown in masks)


def read_photo(
    path: Path, view: ForeignView, mask: Path | None = None, reading: Reading | None = None
) -> TakenPhoto:
    """A photo on the pixels of a pinhole: turned as its file says, its lens undone.

    A photo of another size than its camera, but of the same shape, takes the camera with it.

    Args:
        path: The photo.
        view: Its camera and lens.
        mask: Its mask's file, which counts more than the photo's own alpha. White or opaque is the
            subject: an alpha channel that varies counts, else brightness.
        reading: How camera and mask lie on it; the first that fits by default.

    Raises:
        DataError: not a complete image, or of another shape than its camera or mask.
    """
    reading = reading or fitting_readings(path, view, mask)[0]
    rgba, turn = _opened(path, lambda image: np.asarray(eight_bit(image, "RGBA")))
    alpha, inverted = rgba[..., 3], False
    has_alpha = mask is not None or _tells(alpha)
    if mask is not None:
        values, own = _opened(mask, _marks)
        alpha, inverted = _subject(own.shown(values), mask)
        alpha = turn.stored(alpha) if reading.mask_shown else alpha
        if alpha.shape != rgba.shape[:2]:
            height, width = rgba.shape[:2]
            alpha = _bytes(resampled(alpha.astype(float), (width, height), "bilinear"))
    elif has_alpha:
        alpha, inverted = _subject(alpha, path)
    rgba = np.dstack([rgba[..., :3], alpha])
    if reading.camera_shown:
        rgba, turn = turn.shown(rgba), Turn()
    camera = view.camera.resized(rgba.shape[1], rgba.shape[0])
    taken = _pinhole(rgba, camera, view.lens, has_alpha=has_alpha).turned(turn.quarters)
    return replace(taken, inverted=inverted)


def _other_shape(path: Path, other: str, size: tuple[int, int], got: tuple[int, int]) -> DataError:
    return DataError(
        f"{path} is of another shape than its {other}",
        expected=f"{size[0]} x {size[1]} pixels, or as many times more or fewer",
        got=f"{got[0]} x {got[1]}",
        hint="Give the photos that the cameras were computed from, not cropped, and masks of them",
    )


def _tells(alpha: Bytes) -> bool:
    """Whether an alpha channel (H, W) cuts something out: not one that is the same everywhere."""
    return bool(alpha.min() < alpha.max() and (alpha < 128).mean() > _LEAST_CLEAR)


def _marks(image: Image) -> NDArray[Any]:
    """(H, W) numbers of a mask's file: of alpha where that tells, else of brightness."""
    if image.mode[0] in "IF":
        return np.asarray(image)
    rgba = np.asarray(eight_bit(image, "RGBA"))
    return rgba[..., 3] if _tells(rgba[..., 3]) else rgba[..., :3].max(axis=2)


def _subject(values: NDArray[Any], path: Path) -> tuple[Bytes, bool]:
    """(H, W) uint8 coverage that numbers of 0 to 1, 255 or 65535 mean, and whether it was inverted.

    What is white along most of each side of the frame is what lies around the subject.

    Raises:
        DataError: numbers that are no mask, or one that covers the whole picture.
    """
    low, high = float(values.min()), float(values.max())
    white = next((white for white in (1, 255, 65535) if high <= white), 0)
    inside = float(np.median(values[values > high / 2])) if high > 0 else white
    is_marked = low == 0 and len(np.unique(values)) == 2
    is_lit = _DARK * white < low < high
    if low < 0 or not white or is_lit or (inside < _DIM * white and not is_marked):
        raise DataError(
            f"{path} is no mask of one subject",
            expected="black around the subject, and white (1, 255 or 65535) or one other number",
            got=f"{len(np.unique(values))} numbers from {low:g} to {high:g}",
        )
    is_dim = is_marked or inside < _FULL * white
    coverage = _bytes(values * (255.0 / (inside if is_dim else white)))
    mask = coverage >= 128
    if mask.all():
        raise DataError(f"{path} says that the subject covers the whole picture")
    inverted = all(side.mean() > 0.5 for side in (mask[0], mask[-1], mask[:, 0], mask[:, -1]))
    return (~coverage if inverted else coverage), inverted


@dataclass(frozen=True, slots=True)
class PictureFacts:
    """What a picture's file says of it without its pixels.

    Attributes:
        size: (width, height) as stored.
        turn: How it becomes the picture that viewers show.
        field_deg: Field of view along the longer side, degrees; 0 where the file does not tell.
    """

    size: tuple[int, int]
    turn: Turn
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
        turn = _TURNS.get(exif.get(_ORIENTATION, 1), Turn())
        return PictureFacts(turn.size(image.size) if _is_turned(image) else image.size, turn, field)

    return read_picture(path, _FORMATS, facts)


def _is_turned(image: Image) -> bool:
    """Whether Pillow turns the picture itself, as it does with TIFF alone."""
    return image.format == "TIFF"


def _opened(path: Path, read: Callable[[Image], NDArray[Any]]) -> tuple[NDArray[Any], Turn]:
    """What ``read`` makes of a picture, (H, W) or (H, W, C), as stored; and how it is turned."""

    def content(image: Image) -> tuple[NDArray[Any], Turn]:
        turn = _TURNS.get(image.getexif().get(_ORIENTATION, 1), Turn())
        pixels = read(image)
        return (turn.stored(pixels) if _is_turned(image) else pixels), turn

    return read_picture(path, _FORMATS, content)


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
        camera = Camera(np.array(K), pose, height, width, camera.kind)
    return camera


def _bytes(values: Floats) -> Bytes:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)
