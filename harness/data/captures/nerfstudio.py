"""Nerfstudio's ``transforms.json``, with lens distortion and masks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.cameras.camera import Camera, rigid_inverse
from harness.core.cameras.frames import OPENCV_TO_BLENDER_CAMERA
from harness.core.errors import DataError
from harness.core.files.atomic import read_json
from harness.data.captures.lens import Lens
from harness.data.captures.views import ForeignCameras, ForeignView

_ORDINARY = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_FISHEYE = ("OPENCV_FISHEYE",)


def read_nerfstudio(path: Path) -> ForeignCameras:
    """The cameras of a ``transforms.json``: OpenGL camera axes, in the file's own world axes.

    Intrinsics may stand once for all frames or in each.

    Raises:
        DataError: not such a file, a camera model that is not known here, or poses that are
            mirrored or scaled.
    """
    document = read_json(path)
    views: list[ForeignView] = []
    try:
        for number, frame in enumerate(document["frames"]):
            try:
                views.append(_view({**document, **frame}))
            except DataError as error:
                raise error.located(f"{path}, frame {number}") from error
    except (LookupError, TypeError, ValueError) as error:
        raise DataError(
            f"{path} is not a nerfstudio transforms.json",
            expected="frames with transform_matrix, file_path, fl_x, cx, cy, w, h",
            got=f"{type(error).__name__}: {error}",
        ) from error
    if not views:
        raise DataError(f"{path} has no frames")
    return ForeignCameras(path, "nerfstudio", tuple(views))


def _view(values: Mapping[str, Any]) -> ForeignView:
    focal = float(values["fl_x"])
    K = np.array(
        [
            [focal, 0.0, float(values["cx"])],
            [0.0, float(values.get("fl_y", focal)), float(values["cy"])],
            [0.0, 0.0, 1.0],
        ]
    )
    matrix = np.array(values["transform_matrix"], dtype=np.float64)
    if matrix.shape != (4, 4):
        raise ValueError(f"a transform_matrix of shape {matrix.shape}")
    camera = Camera(
        K, rigid_inverse(matrix @ OPENCV_TO_BLENDER_CAMERA), int(values["w"]), int(values["h"])
    )
    image, mask = str(values["file_path"]), str(values.get("mask_path") or "")
    return ForeignView(image, camera, _lens(values), mask)


def _lens(values: Mapping[str, Any]) -> Lens:
    model = values.get("camera_model", "OPENCV")
    if model not in (*_ORDINARY, *_FISHEYE):
        raise DataError(
            f"camera model {model} is not known",
            expected=", ".join((*_ORDINARY, *_FISHEYE)),
            hint="Undistort the images first",
        )
    radial = [float(values.get(f"k{n}") or 0.0) for n in range(1, 5)]
    if model in _FISHEYE:
        return Lens.of(tuple(radial), fisheye=True)
    # In files of ordinary lenses k4 is the fourth radial number, which OpenCV's model has below.
    if radial[3]:
        raise DataError(
            "a lens with k4 is not known", expected="k1, k2, k3, p1, p2", got=f"k4 = {radial[3]}",
            hint="Undistort the images first",
        )  # fmt: skip
    tangential = tuple(float(values.get(name) or 0.0) for name in ("p1", "p2"))
    return Lens.of(tuple(radial[:3]), tangential)
