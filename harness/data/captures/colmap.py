"""COLMAP's sparse models, text and binary: cameras with their lenses, and images with their poses.

Only ``cameras`` and ``images`` are read; points are not needed. A pixel's centre is at (0.5, 0.5)
in both programs. The binary form is little-endian without padding:

    cameras.bin  count u64; each: id u32, model i32, width u64, height u64, parameters f64 ...
    images.bin   count u64; each: id u32, quaternion wxyz 4 f64, translation 3 f64, camera u32,
                 name ending in a zero byte, points u64, each point 2 f64 and i64
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera
from harness.core.cameras.frames import quaternion_from_rotation, rotation_from_quaternion
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path
from harness.data.captures.lens import Lens
from harness.data.captures.views import ForeignCameras, ForeignView

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


#: By COLMAP's number of the model. Those that are not here (FOV, THIN_PRISM_FISHEYE) are refused.
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
_PINHOLE = 1


@dataclass(frozen=True, slots=True, eq=False)
class _Intrinsics:
    """Of one COLMAP camera, which several images may share."""

    K: Floats
    size: tuple[int, int]
    lens: Lens

    @classmethod
    def of(cls, model: _Model, size: tuple[int, int], numbers: Sequence[float]) -> _Intrinsics:
        if len(numbers) != model.count:
            raise ValueError(f"{len(numbers)} parameters of model {model.name}")
        focals, (cx, cy) = numbers[: model.focals], numbers[model.focals : model.focals + 2]
        K = np.array([[focals[0], 0.0, cx], [0.0, focals[-1], cy], [0.0, 0.0, 1.0]])
        return cls(K, size, model.lens(tuple(numbers[model.focals + 2 :])))


@dataclass(frozen=True, slots=True)
class _Image:
    """An image's entry in either form."""

    number: int
    pose: tuple[float, ...]
    camera: int
    name: str


def read_colmap_text(folder: Path) -> ForeignCameras:
    """The cameras of ``cameras.txt`` and ``images.txt``, in the order of image numbers.

    Raises:
        DataError: not such a model, or a camera model that is not known here.
    """

    def content() -> tuple[ForeignView, ...]:
        cameras = dict(_text_cameras(_lines(folder / "cameras.txt")))
        return _views(cameras, list(_text_images(_lines(folder / "images.txt"))))

    return ForeignCameras(folder, "COLMAP text", _read(folder, "txt", content))


def read_colmap_binary(folder: Path) -> ForeignCameras:
    """The cameras of ``cameras.bin`` and ``images.bin``, in the order of image numbers.

    Raises:
        DataError: not such a model, truncated, or a camera model that is not known here.
    """

    def content() -> tuple[ForeignView, ...]:
        cameras = dict(_binary_cameras(_Bytes.of(folder / "cameras.bin")))
        return _views(cameras, list(_binary_images(_Bytes.of(folder / "images.bin"))))

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


def _views(cameras: Mapping[int, _Intrinsics], images: list[_Image]) -> tuple[ForeignView, ...]:
    views: list[ForeignView] = []
    for image in sorted(images, key=lambda entry: entry.number):
        taken_with = cameras[image.camera]
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_quaternion(image.pose[:4])
        pose[:3, 3] = image.pose[4:]
        camera = Camera(taken_with.K, pose, *taken_with.size)
        views.append(ForeignView(image.name, camera, taken_with.lens))
    return tuple(views)


def _known(models: Mapping[int, _Model] | Mapping[str, _Model], key: int | str) -> _Model:
    for known, model in models.items():
        if known == key:
            return model
    raise DataError(
        f"camera model {key} is not known",
        expected=", ".join(_BY_NAME),
        hint="Undistort the images with COLMAP's image_undistorter first",
    )


def _lines(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    return [line for line in text.splitlines() if not line.startswith("#")]


def _text_cameras(lines: list[str]) -> Iterator[tuple[int, _Intrinsics]]:
    for line in filter(str.strip, lines):
        number, name, width, height, *numbers = line.split()
        size, values = (int(width), int(height)), [float(text) for text in numbers]
        yield int(number), _Intrinsics.of(_known(_BY_NAME, name), size, values)


def _text_images(lines: list[str]) -> Iterator[_Image]:
    remaining = iter(lines)
    for line in filter(str.strip, remaining):
        number, *pose, camera, name = line.split(maxsplit=9)
        yield _Image(int(number), tuple(map(float, pose)), int(camera), name.strip())
        next(remaining, "")  # the image's 2-D points, which may be none


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


def _binary_cameras(file: _Bytes) -> Iterator[tuple[int, _Intrinsics]]:
    for _ in range(file.count()):
        number, model_number, width, height = map(int, file.take("IiQQ"))
        model = _known(_MODELS, model_number)
        numbers = file.take(f"{model.count}d")
        yield number, _Intrinsics.of(model, (width, height), numbers)


def _binary_images(file: _Bytes) -> Iterator[_Image]:
    for _ in range(file.count()):
        number, *pose, camera = file.take("I7dI")
        name = file.text()
        file.skip(_POINT_BYTES * file.count())
        yield _Image(int(number), tuple(pose), int(camera), name)


def write_colmap_binary(folder: Path, cameras: Sequence[Camera], images: Sequence[str]) -> None:
    """Write COLMAP's binary model, world unchanged: cameras, images, and no points."""
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
