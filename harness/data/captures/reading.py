"""Which program a camera file is of, and its cameras."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from harness.core.artifacts import Capture, image_name
from harness.core.errors import DataError
from harness.data.captures.colmap import read_colmap_binary, read_colmap_text
from harness.data.captures.nerfstudio import read_nerfstudio
from harness.data.captures.published import read_published
from harness.data.captures.views import ForeignCameras, ForeignView

#: What can be read, for messages.
LAYOUTS = (
    "nerfstudio's transforms.json, a folder with COLMAP's cameras and images (.txt or .bin), "
    "a published camera_parameters.json, or a capture.json"
)
#: Where camera files usually lie, below or beside the photos.
_USUAL = ("transforms.json", "capture.json", "cameras.bin", "cameras.txt", "sparse/0", "sparse",
          "colmap/sparse/0", "../transforms.json", "../sparse/0", "../sparse")  # fmt: skip


def find_cameras(folder: Path) -> Path:
    """The camera file in a folder of photos, in the usual places.

    Raises:
        DataError: there is none, or there are several published camera files.
    """
    for name in _USUAL:
        if _reader(folder / name) is not None:
            return folder / name
    beside = (
        *folder.glob("*camera_parameters.json"),
        *folder.parent.glob("*camera_parameters.json"),
    )
    published = sorted(beside)
    if len(published) != 1:
        raise DataError(
            f"no camera file in {folder}", expected=LAYOUTS, hint="Name it with --cameras FILE"
        )
    return published[0]


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
        raise DataError(f"{path} is no camera file that is known", expected=LAYOUTS)
    return reader()


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
