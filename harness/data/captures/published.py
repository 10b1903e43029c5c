"""The camera file that was published with MExECON: read with the core's reader, and written."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from harness.core.cameras.camera import Camera, rigid_inverse
from harness.core.cameras.frames import (
    BLENDER_TO_WORLD,
    quaternion_from_rotation,
    read_published_cameras,
)
from harness.core.errors import DataError
from harness.core.files.atomic import write_text
from harness.data.captures.views import ForeignCameras, ForeignView

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
