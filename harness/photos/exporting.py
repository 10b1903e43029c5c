"""A capture as plain photos with a camera file, for other programs."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.artifacts import Capture
from harness.core.camera_frames import write_colmap, write_transforms_json
from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.atomic import atomic_directory
from harness.data.camera_files import write_published
from harness.data.colmap import write_colmap_binary
from harness.geometry.images import composite, load_rgba, save_png
from harness.run.sources import captures_below, imported_capture
from harness.run.workspace import Workspace

#: What cameras can be written as.
FORMATS = ("colmap-binary", "colmap-text", "nerfstudio", "published")


@dataclass(frozen=True, slots=True)
class ExportRequest:
    """What ``harness capture export`` was asked for.

    Attributes:
        folder: To be made; it must not be there, or be empty.
        cameras: One of ``FORMATS``.
        alpha: Whether photos keep their alpha; without it the person stands before ``background``.
        background: (3,) sRGB of 0 to 255.
        masks: Whether masks are written as files, too.
    """

    folder: Path
    cameras: str = FORMATS[0]
    alpha: bool = True
    background: tuple[int, int, int] = (128, 128, 128)
    masks: bool = False


def named_capture(workspace: Workspace, name: str) -> Capture:
    """The capture of a name among those imported, or in a folder.

    Raises:
        DataError: there is none, or it is damaged.
    """
    if not (Path(name) / "capture.json").is_file():
        if hint := captures_below(Path(name)):
            raise DataError(f"{name} holds no capture.json", hint=hint)
        return imported_capture(workspace, name)
    capture = Capture.load(Path(name))
    if damage := capture.damage():
        raise DataError(f"capture {name} cannot be used: {damage}")
    return capture


def export_capture(capture: Capture, request: ExportRequest) -> tuple[str, ...]:
    """Write photos and cameras, as a whole; the names of the photos.

    Photos go to ``images/``, masks to ``masks/``, COLMAP's model to ``sparse/0/``, other camera
    files beside ``images/``. COLMAP's world is ours (+Y up, metres); the others' has +Z up.

    Raises:
        HarnessError: a form that is not known, or a folder that is not empty.
        DataError: cameras that the form cannot hold, or the disk refuses.
    """
    if request.cameras not in FORMATS:
        raise HarnessError(
            f"unknown camera format '{request.cameras}'",
            hint=did_you_mean(request.cameras, FORMATS),
        )
    if request.folder.exists() and any(request.folder.iterdir()):
        raise HarnessError(f"{request.folder} is not empty", hint="Name a folder that is not there")
    names = tuple(f"{view:03d}.png" for view in range(len(capture.cameras)))
    with atomic_directory(request.folder.resolve()) as folder:
        for view, name in enumerate(names):
            rgba = load_rgba(capture.image_path(view), capture.cameras[view].size)
            picture = rgba
            if not request.alpha:
                ground = np.array(request.background) / 255.0
                picture = np.round(255 * composite(rgba, ground)).astype(np.uint8)
            save_png(folder / "images" / name, picture)
            if request.masks:
                save_png(folder / "masks" / name, np.ascontiguousarray(rgba[..., 3]))
        _write_cameras(capture, request.cameras, names, folder)
    return names


def _write_cameras(capture: Capture, cameras: str, names: tuple[str, ...], folder: Path) -> None:
    if cameras == "colmap-binary":
        write_colmap_binary(folder / "sparse" / "0", capture.cameras, names)
    elif cameras == "colmap-text":
        write_colmap(folder / "sparse" / "0", capture.cameras, names)
    elif cameras == "nerfstudio":
        images = [f"images/{name}" for name in names]
        write_transforms_json(folder / "transforms.json", capture.cameras, images)
    else:
        write_published(folder / "camera_parameters.json", capture.cameras)
