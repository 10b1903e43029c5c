"""Read camera files: nerfstudio, published parameters, COLMAP."""

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, image_name
from harness.core.camera import Camera, rigid_inverse
from harness.core.camera_frames import (
    BLENDER_TO_WORLD,
    OPENCV_TO_BLENDER_CAMERA,
    quaternion_from_rotation,
    read_published_cameras,
    require_perspective,
)
from harness.core.errors import DataError
from harness.core.files.atomic import read_json, write_text
from harness.data.colmap import read_colmap_binary, read_colmap_text
from harness.data.lens import ForeignCameras, ForeignView, Lens
from harness.data.pictures import NamedPictures, photo_folder, picture_facts

_ORDINARY = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_FISHEYE = "OPENCV_FISHEYE"
#: Parallel rays, whose focal lengths are pixels per unit of length.
_PARALLEL = "ORTHOPHOTO"
#: Other ways to tell cameras and poses that instant-ngp or nerfstudio read.
_OTHER_KINDS = ("ftheta_p0", "latlong", "equirectangular", "orthographic", "from_mitsuba",
                "distortion_params", "distortion", "rolling_shutter")  # fmt: skip
#: Camera files of the field that nothing here reads, by their ends.
_UNREAD = {
    "annots.npy": "annots.npy is pickled objects, which are not read: put intri.yml and extri.yml "
    "of the sequence there, and name the set: --cameras zju",
    ".csd": "What stands in a scanner's .csd, as PuzzleIOI has it, is not known here: write its "
    "cameras as nerfstudio's transforms.json",
}
#: What each lens has. The k4 of an ordinary lens is the fourth radial number in these files, which
#: OpenCV's model has below the line; with k5, k6 and the like it is refused.
_PARAMETER = re.compile(r"[kpsb]\d")
_ORDINARY_HAS, _FISHEYE_HAS = ("k1", "k2", "k3", "p1", "p2"), ("k1", "k2", "k3", "k4")


def read_nerfstudio(path: Path, photos: Path | None = None) -> ForeignCameras:
    """The cameras of a ``transforms.json``: OpenGL camera axes, in the file's own world axes.

    Intrinsics may stand once for all frames or in each, which counts more. A focal length is
    ``fl_x`` or comes from ``camera_angle_x``. A size that does not stand there is that of the
    photo, or where it is missing that of another one; the middle is then the picture's.

    Args:
        path: The file.
        photos: Folder that the user named for photos; that of the file by default.

    Raises:
        DataError: not such a file, a camera model that is not known here, or poses that are
            mirrored or scaled.
    """
    document = read_json(path)
    frames = document.get("frames")
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise DataError(
            f"{path} is not a nerfstudio transforms.json",
            expected="a list of frames with file_path and transform_matrix",
        )
    if not frames:
        raise DataError(f"{path} has no frames")
    pictures = NamedPictures(path, photos or path.parent)

    def size(name: str) -> tuple[int, int]:
        others = (pictures.find(str(frame.get("file_path"))) for frame in frames)
        photo = pictures.find(name) or next(filter(None, others), None)
        if photo is None:
            raise DataError("no w and h, and no photo is there to tell them")
        return picture_facts(photo).size

    views: list[ForeignView] = []
    for number, frame in enumerate(frames):
        try:
            views.append(_view(document, frame, size))
        except DataError as error:
            raise error.located(f"{path}, frame {number}") from error
    return ForeignCameras(path, "nerfstudio", tuple(views))


def _view(
    document: Mapping[str, Any], frame: Mapping[str, Any], size: Callable[[str], tuple[int, int]]
) -> ForeignView:
    values = {**document, **frame}
    image, mask = values.get("file_path"), values.get("mask_path") or ""
    if not (isinstance(image, str) and image and isinstance(mask, str)):
        raise DataError("file_path is no text", got=repr(image), hint="Name the photo there")
    width, height = _number(values, "w"), _number(values, "h")
    if width is None or height is None:
        width, height = size(image)
    is_parallel = values.get("camera_model") == _PARALLEL
    spanned = (0.0, 0.0) if is_parallel else (width, height)  # no angle is between parallel rays
    fx, fy = _focal_lengths(frame, document, spanned)
    cx, cy = _number(values, "cx"), _number(values, "cy")
    middle = (width / 2 if cx is None else cx, height / 2 if cy is None else cy)
    K = np.array([[fx, 0.0, middle[0]], [0.0, fy, middle[1]], [0.0, 0.0, 1.0]])
    pose = rigid_inverse(_matrix(values) @ OPENCV_TO_BLENDER_CAMERA)
    lens = _lens(values)
    if is_parallel and lens.bends:
        raise DataError(f"a lens with distortion in front of parallel rays ({_PARALLEL})")
    kind = "orthographic" if is_parallel else "perspective"
    return ForeignView(image, Camera(K, pose, int(width), int(height), kind), lens, mask)


def _number(values: Mapping[str, Any], key: str) -> float | None:
    """A number of a frame; None where it does not stand there."""
    value = values.get(key)
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise DataError(f"{key} is no number", got=repr(value)[:80])
    return number


def _focal_lengths(
    frame: Mapping[str, Any], document: Mapping[str, Any], size: tuple[float, float]
) -> tuple[float, float]:
    """Of the frame itself, else of the document; one that is missing is as long as the other."""
    for values in (frame, document):
        both = (_focal_length(values, axis, side) for axis, side in zip("xy", size, strict=True))
        known = [focal for focal in both if focal is not None]
        if known:
            return known[0], known[-1]
    raise DataError("no focal length", expected="fl_x in pixels, or camera_angle_x in radians")


def _focal_length(values: Mapping[str, Any], axis: str, side: float) -> float | None:
    """Of one axis; None where nothing tells it. A side of 0 is one that no angle spans."""
    focal, angle = _number(values, f"fl_{axis}"), _number(values, f"camera_angle_{axis}")
    if focal is not None or angle is None or not side:
        return focal
    if not 0 < angle < math.pi:
        raise DataError(f"camera_angle_{axis} is no angle in radians", got=str(angle))
    return side / 2 / math.tan(angle / 2)


def _matrix(values: Mapping[str, Any]) -> Floats:
    """(4, 4) from the camera to the world."""
    try:
        matrix = np.array(values.get("transform_matrix"), dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape == (3, 4):
        matrix = np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])
    if matrix.shape != (4, 4) or matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise DataError(
            "no transform_matrix from camera to world",
            expected="four rows of four numbers, the last of them 0 0 0 1",
            got=str(values.get("transform_matrix"))[:200],
        )
    return matrix


def _lens(values: Mapping[str, Any]) -> Lens:
    is_fisheye = values.get("is_fisheye")
    model = values.get("camera_model") or (_FISHEYE if is_fisheye else "OPENCV")
    said = {name: values.get(name) for name in _OTHER_KINDS}
    # A list of zeros says that there is none.
    kinds = [
        name for name, value in said.items() if (any(value) if isinstance(value, list) else value)
    ]
    if is_fisheye not in (None, model == _FISHEYE):
        kinds.append(f"{model} with is_fisheye {is_fisheye}")
    if kinds or model not in (*_ORDINARY, _FISHEYE, _PARALLEL):
        raise DataError(
            f"camera model {', '.join(kinds) or model} is not known",
            expected=", ".join((*_ORDINARY, _FISHEYE, _PARALLEL)),
            hint="Undistort the images first",
        )
    numbers = {key: _number(values, key) or 0.0 for key in values if _PARAMETER.fullmatch(key)}
    has = _FISHEYE_HAS if model == _FISHEYE else _ORDINARY_HAS
    more = [f"{key} = {number}" for key, number in numbers.items() if number and key not in has]
    if more:
        raise DataError(
            f"a lens with {more[0].split()[0]} is not known", expected=", ".join(has),
            got=", ".join(more), hint="Undistort the images first",
        )  # fmt: skip
    first = [numbers.get(key, 0.0) for key in has]
    if model == _FISHEYE:
        return Lens.of(tuple(first), fisheye=True)
    return Lens.of(tuple(first[:3]), tuple(first[3:]))


#: From OpenCV's camera axes to the file's: x left, y up, z forward.
_LEFT_UP_FORWARD = np.diag([-1.0, -1.0, 1.0, 1.0])


def read_published(path: Path) -> ForeignCameras:
    """The cameras of a published file in its own world axes (Blender's, Z up).

    The file names no photos: they go by the order of their names.

    Raises:
        DataError: not such a file.
    """
    to_file = rigid_inverse(BLENDER_TO_WORLD)
    cameras = (camera.in_frame(to_file) for camera in read_published_cameras(path))
    return ForeignCameras(path, "published", tuple(ForeignView("", camera) for camera in cameras))


def write_published(path: Path, cameras: Sequence[Camera]) -> None:
    """Write cameras in the published form, which has square pixels and the middle in the centre.

    Raises:
        DataError: a camera that the form cannot hold.
    """
    require_perspective(cameras, "cannot be written in the published form")
    entries: list[dict[str, object]] = []
    for number, camera in enumerate(cameras):
        K = camera.K
        square = abs(K[0, 0] - K[1, 1]) < 1e-6 * K[0, 0]
        centred = np.allclose(K[:2, 2], np.array(camera.size) / 2, atol=1e-3)
        if not square or not centred:
            raise DataError(
                f"camera {number} cannot be written in the published form",
                expected="square pixels and the optical axis in the picture's centre",
                got=f"K {K.tolist()}, size {camera.size}",
                hint="Export as COLMAP or nerfstudio",
            )
        pose = rigid_inverse(BLENDER_TO_WORLD) @ camera.camera_to_world @ _LEFT_UP_FORWARD
        entries.append(
            {
                "frame": number,
                "location": pose[:3, 3].tolist(),
                "quaternion": quaternion_from_rotation(pose[:3, :3]).tolist(),
                "focal_length_px": float(K[0, 0]),
                "image_size": [camera.width, camera.height],
            }
        )
    write_text(path, json.dumps(entries, indent=2) + "\n")


#: What can be read, for messages.
LAYOUTS = (
    "nerfstudio's transforms.json, a folder with COLMAP's cameras and images (.txt or .bin), "
    "a published camera_parameters.json, or a capture.json"
)
#: Where camera files usually lie, below or beside the photos.
_USUAL = ("transforms.json", "capture.json", "cameras.bin", "cameras.txt", "sparse/0", "sparse",
          "colmap/sparse/0", "../transforms.json", "../sparse/0", "../sparse")  # fmt: skip


def camera_file(folder: Path, named: Path | None = None) -> str:
    """The camera file that is named, or the one in a folder of photos; empty where there is none.

    Raises:
        DataError: several published camera files, or no such folder.
    """
    if named is not None:
        return str(named.resolve())
    below = photo_folder(folder)
    for name in _USUAL:
        if _reader(below / name) is not None:
            return str((below / name).resolve())
    beside = (
        *below.glob("*camera_parameters.json"),
        *below.parent.glob("*camera_parameters.json"),
    )
    published = sorted(beside)
    if len(published) > 1:
        raise DataError(
            f"several camera files in {folder}", expected=LAYOUTS, hint="Name one with --cameras"
        )
    return str(published[0].resolve()) if published else ""


def read_cameras(path: str | Path, photos: Path | None = None) -> ForeignCameras:
    """The cameras in a file or folder, in its own world axes and unit of length.

    Args:
        path: The file or folder.
        photos: Folder that the user named for photos, which tell sizes that the file does not.

    Raises:
        DataError: no such file, a layout that is not known, or a damaged file.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(f"no camera file at {path}")
    reader = _reader(path, photos)
    if reader is None:
        hint = unread(path.name)
        raise DataError(f"{path} is no camera file that is known", expected=LAYOUTS, hint=hint)
    return reader()


def unread(*names: str) -> str:
    """What to do in place of camera files of the field that are not read; nothing for others."""
    found = [why for end, why in _UNREAD.items() if any(name.endswith(end) for name in names)]
    return found[0] if found else ""


def _reader(path: Path, photos: Path | None = None) -> Callable[[], ForeignCameras] | None:
    """What reads a file or folder; None where nothing does."""
    folder = path if path.is_dir() else path.parent
    if path.is_dir() or path.suffix in (".bin", ".txt"):
        if path.suffix != ".txt" and _has(folder, "bin"):
            return lambda: read_colmap_binary(folder)
        return (lambda: read_colmap_text(folder)) if _has(folder, "txt") else None
    if not path.is_file() or path.suffix.lower() != ".json":
        return None
    if path.name == "capture.json":
        return lambda: _capture(path.parent)
    if _is_list(path):
        return lambda: read_published(path)
    return lambda: read_nerfstudio(path, photos)


def _has(folder: Path, suffix: str) -> bool:
    return all((folder / f"{name}.{suffix}").is_file() for name in ("cameras", "images"))


def _is_list(path: Path) -> bool:
    try:
        return isinstance(json.loads(path.read_text(encoding="utf-8-sig")), list)
    except (OSError, ValueError, RecursionError):
        return False  # the reader of the other form says what is wrong


def _capture(folder: Path) -> ForeignCameras:
    """The cameras of a capture of our own; the world is ours."""
    capture = Capture.load(folder)
    views = tuple(
        ForeignView(image_name(number), camera) for number, camera in enumerate(capture.cameras)
    )
    return ForeignCameras(folder / "capture.json", "capture", views, True, capture.front_yaw_deg)
