"""COLMAP's sparse models, text and binary: cameras with their lenses, and images with their poses.

Only ``cameras`` and ``images`` are read; points are not needed. A pixel's centre is at (0.5, 0.5)
in both programs. The binary form is little-endian without padding:

    cameras.bin  count u64; each: id u32, model i32, width u64, height u64, parameters f64 ...
    images.bin   count u64; each: id u32, quaternion wxyz 4 f64, translation 3 f64, camera u32,
                 name ending in a zero byte, points u64, each point 2 f64 and i64

In the text form each image's line is followed by a line of its 2-D points, which may be empty, or,
as other programs write it, missing.
"""

from __future__ import annotations

import contextlib
import re
import struct
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.camera_frames import (
    quaternion_from_rotation,
    require_perspective,
    rotation_from_quaternion,
)
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path
from harness.data.lens import ForeignCameras, ForeignView, Lens

Entry = TypeVar("Entry")

_MOST_BYTES = 4 * 2**30
_POINT_BYTES = 24


@dataclass(frozen=True, slots=True)
class _Model:
    """A camera model: how many focal lengths it has, then the middle, then what the lens does."""

    name: str
    focals: int
    bend: int
    lens: Callable[[tuple[float, ...]], Lens]

    @property
    def count(self) -> int:
        """Number of parameters."""
        return self.focals + 2 + self.bend


def _opencv(values: tuple[float, ...]) -> Lens:
    return Lens.of(values[:2], values[2:4])


def _full_opencv(values: tuple[float, ...]) -> Lens:
    return Lens.of((*values[:2], *values[4:]), values[2:4])


def _fisheye(values: tuple[float, ...]) -> Lens:
    return Lens.of(values, fisheye=True)


#: By COLMAP's number of the model.
_MODELS = {
    0: _Model("SIMPLE_PINHOLE", 1, 0, Lens.of),
    1: _Model("PINHOLE", 2, 0, Lens.of),
    2: _Model("SIMPLE_RADIAL", 1, 1, Lens.of),
    3: _Model("RADIAL", 1, 2, Lens.of),
    4: _Model("OPENCV", 2, 4, _opencv),
    5: _Model("OPENCV_FISHEYE", 2, 4, _fisheye),
    6: _Model("FULL_OPENCV", 2, 8, _full_opencv),
    8: _Model("SIMPLE_RADIAL_FISHEYE", 1, 1, _fisheye),
    9: _Model("RADIAL_FISHEYE", 1, 2, _fisheye),
}
_BY_NAME = {model.name: model for model in _MODELS.values()}
#: Those that are refused, by their name in the binary form, too.
_REFUSED = {7: "FOV", 10: "THIN_PRISM_FISHEYE", 11: "RAD_TAN_THIN_PRISM_FISHEYE"}
_PINHOLE = 1
#: A line of points: x, y and the number of the 3-D point, again and again.
_THREES = re.compile(r"(?:[-+.\deE]+\s+[-+.\deE]+\s+-?\d+(?:\s+|$))+")
#: How many entries a comment says that there are.
_PROMISE = re.compile(r"^\s*#\s*Number of (?:cameras|images):\s*(\d+)", re.MULTILINE)


@dataclass(frozen=True, slots=True, eq=False)
class _Intrinsics:
    """Of one COLMAP camera, which several images may share."""

    K: Floats
    size: tuple[int, int]
    lens: Lens

    @classmethod
    def of(cls, model: _Model, size: tuple[int, int], numbers: Sequence[float]) -> _Intrinsics:
        if len(numbers) != model.count:
            raise DataError(
                f"a camera of model {model.name} has {len(numbers)} parameters",
                expected=f"{model.count}: focal length, middle, then what the lens does",
                got=" ".join(map(str, numbers)) or "none",
            )
        focals, (cx, cy) = numbers[: model.focals], numbers[model.focals : model.focals + 2]
        K = np.array([[focals[0], 0.0, cx], [0.0, focals[-1], cy], [0.0, 0.0, 1.0]])
        return cls(K, size, model.lens(tuple(numbers[model.focals + 2 :])))


@dataclass(frozen=True, slots=True)
class _Image:
    """An image's entry in either form."""

    pose: tuple[float, ...]
    camera: int
    name: str


def read_colmap_text(folder: Path) -> ForeignCameras:
    """The cameras of ``cameras.txt`` and ``images.txt``, in the order of image numbers.

    Raises:
        DataError: not such a model, or a camera model that is not known here.
    """

    def content() -> tuple[ForeignView, ...]:
        cameras = _numbered(_text_cameras, folder / "cameras.txt")
        return _views(cameras, _numbered(_text_images, folder / "images.txt"))

    return ForeignCameras(folder, "COLMAP text", _read(folder, "txt", content))


def read_colmap_binary(folder: Path) -> ForeignCameras:
    """The cameras of ``cameras.bin`` and ``images.bin``, in the order of image numbers.

    Raises:
        DataError: not such a model, truncated, or a camera model that is not known here.
    """

    def content() -> tuple[ForeignView, ...]:
        cameras = _numbered(_binary_cameras, folder / "cameras.bin")
        return _views(cameras, _numbered(_binary_images, folder / "images.bin"))

    return ForeignCameras(folder, "COLMAP binary", _read(folder, "bin", content))


def _read(
    folder: Path, suffix: str, content: Callable[[], tuple[ForeignView, ...]]
) -> tuple[ForeignView, ...]:
    try:
        views = content()
    except DataError as error:
        raise error.located(folder) from error
    except (OSError, ValueError, LookupError, struct.error, UnicodeDecodeError) as error:
        raise DataError(
            f"{folder} is not a COLMAP model",
            expected=f"whole files cameras.{suffix} and images.{suffix}",
            got=f"{type(error).__name__}: {error}",
            hint="Export the model again, for instance with COLMAP's model_converter",
        ) from error
    if not views:
        raise DataError(f"{folder} has no images", hint="COLMAP registered none: add photos")
    return views


def _numbered(
    entries: Callable[[Path], Iterator[tuple[int, Entry]]], path: Path
) -> dict[int, Entry]:
    """The entries of a file by their numbers, of which none stands twice; as many as it says."""
    found: dict[int, Entry] = {}
    for number, entry in entries(path):
        if number in found:
            raise DataError(f"{path.name} has two entries of number {number}")
        found[number] = entry
    promise = _PROMISE.search(_text(path)) if path.suffix == ".txt" else None
    if promise and int(promise[1]) != len(found):
        raise DataError(
            f"{path.name} says that it has {promise[1]} entries",
            got=str(len(found)),
            hint="Export the model again, or correct the number if entries were removed",
        )
    return found


def _views(
    cameras: Mapping[int, _Intrinsics], images: Mapping[int, _Image]
) -> tuple[ForeignView, ...]:
    views: list[ForeignView] = []
    for number, image in sorted(images.items()):
        try:
            if image.camera not in cameras:
                raise DataError(
                    f"it was taken with camera {image.camera}, which the model does not have",
                    expected=f"one of {', '.join(map(str, sorted(cameras))) or 'none'}",
                    hint="Export the whole model again",
                )
            taken_with = cameras[image.camera]
            pose = np.eye(4)
            pose[:3, :3] = rotation_from_quaternion(image.pose[:4])
            pose[:3, 3] = image.pose[4:]
            camera = Camera(taken_with.K, pose, *taken_with.size)
        except DataError as error:
            raise error.located(f"image {number}, '{image.name}'") from error
        views.append(ForeignView(image.name, camera, taken_with.lens))
    return tuple(views)


def _known(models: Mapping[int, _Model] | Mapping[str, _Model], key: int | str) -> _Model:
    for known, model in models.items():
        if known == key:
            return model
    name = _REFUSED.get(key, f"number {key}") if isinstance(key, int) else key
    raise DataError(
        f"camera model {name} is not known",
        expected=", ".join(_BY_NAME),
        hint="Undistort the images with COLMAP's image_undistorter first",
    )


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8-sig")


def _lines(path: Path) -> list[tuple[str, str]]:
    """Where each line that is no comment stands, and its content."""
    lines = enumerate(_text(path).split("\n"), start=1)
    stripped = ((f"{path.name}, line {number}", line.strip()) for number, line in lines)
    return [(place, line) for place, line in stripped if not line.startswith("#")]


@contextlib.contextmanager
def _read_as(form: str, place: str, line: str) -> Generator[None]:
    """Errors about a line say where it stands, and what it should be."""
    try:
        yield
    except DataError as error:
        raise error.located(place) from error
    except ValueError as error:
        raise DataError(f"{place} cannot be read", expected=form, got=line[:80]) from error


def _text_cameras(path: Path) -> Iterator[tuple[int, _Intrinsics]]:
    for place, line in _lines(path):
        if line:
            with _read_as("CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS", place, line):
                number, name, width, height, *numbers = line.split()
                size, values = (int(width), int(height)), [float(text) for text in numbers]
                entry = int(number), _Intrinsics.of(_known(_BY_NAME, name), size, values)
            yield entry


def _text_images(path: Path) -> Iterator[tuple[int, _Image]]:
    after_image = False
    for place, line in _lines(path):
        # The image's 2-D points, which may be none; other programs leave the line out.
        is_points = not line or (after_image and _THREES.fullmatch(line) is not None)
        after_image = not is_points
        if after_image:
            with _read_as("IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", place, line):
                number, a, b, c, d, x, y, z, camera, name = line.split(maxsplit=9)
                pose = tuple(map(float, (a, b, c, d, x, y, z)))
                entry = int(number), _Image(pose, int(camera), name)
            yield entry


@dataclass(slots=True)
class _Bytes:
    """A file that is read from front to back."""

    content: bytes
    position: int = 0

    @classmethod
    def of(cls, path: Path) -> _Bytes:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"{path.name} is larger than {_MOST_BYTES} bytes")
        return cls(path.read_bytes())

    def take(self, form: str) -> tuple[float, ...]:
        values = struct.unpack_from(f"<{form}", self.content, self.position)
        self.position += struct.calcsize(f"<{form}")
        return values

    def count(self) -> int:
        (number,) = self.take("Q")
        return int(number)

    def text(self) -> str:
        end = self.content.index(b"\0", self.position)
        found = self.content[self.position : end].decode("utf-8")
        self.position = end + 1
        return found

    def skip(self, size: int) -> None:
        self.position += size
        if self.position > len(self.content):
            raise ValueError("the file ends before its last entry does")

    def require_end(self) -> None:
        if self.position < len(self.content):
            raise ValueError(f"{len(self.content) - self.position} bytes after the last entry")


def _binary_cameras(path: Path) -> Iterator[tuple[int, _Intrinsics]]:
    file = _Bytes.of(path)
    for _ in range(file.count()):
        number, model_number, width, height = map(int, file.take("IiQQ"))
        model = _known(_MODELS, model_number)
        numbers = file.take(f"{model.count}d")
        yield number, _Intrinsics.of(model, (width, height), numbers)
    file.require_end()


def _binary_images(path: Path) -> Iterator[tuple[int, _Image]]:
    file = _Bytes.of(path)
    for _ in range(file.count()):
        number, *pose, camera = file.take("I7dI")
        name = file.text()
        file.skip(_POINT_BYTES * file.count())
        yield int(number), _Image(tuple(pose), int(camera), name)
    file.require_end()


def write_colmap_binary(folder: Path, cameras: Sequence[Camera], images: Sequence[str]) -> None:
    """As ``write_colmap``, COLMAP's binary model."""
    require_perspective(cameras, "cannot be written in COLMAP's form")
    taken = bytearray(struct.pack("<Q", len(cameras)))
    placed = bytearray(struct.pack("<Q", len(cameras)))
    for number, (camera, image) in enumerate(zip(cameras, images, strict=True), start=1):
        K, pose = camera.K, camera.world_to_camera
        taken += struct.pack("<IiQQ", number, _PINHOLE, *camera.size)
        taken += struct.pack("<4d", K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        numbers = (*quaternion_from_rotation(camera.rotation), *pose[:3, 3])
        placed += struct.pack("<I7dI", number, *numbers, number)
        placed += image.encode() + b"\0" + struct.pack("<Q", 0)
    nothing = struct.pack("<Q", 0)
    for name, content in (("cameras", taken), ("images", placed), ("points3D", nothing)):
        with atomic_path(folder / f"{name}.bin") as temporary:
            temporary.write_bytes(bytes(content))
