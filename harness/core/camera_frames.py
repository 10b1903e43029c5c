"""Conversions between our camera convention and those of Blender, nerfstudio, COLMAP and MExECON.

Ours is OpenCV axes (x right, y down, z forward) in a right-handed world with +Y up, the subject
facing +Z. Blender's world has +Z up, and what stands upright in it faces -Y: that is how Blender
reads an OBJ file, so that our world is also the frame of a file that faces its own +Z.
"""

import contextlib
import json
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from harness.core.arrays import Floats
from harness.core.camera import Camera, rigid_inverse
from harness.core.errors import DataError
from harness.core.files.atomic import write_json, write_text

#: (4, 4) from Blender's world (Z up, front -Y) to ours (Y up, front +Z): (x, y, z) is (x, z, -y).
BLENDER_TO_WORLD: Floats = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
#: (3, 3) from the world of the body model Anny (metres, Z up, front -Y, as Blender's) to ours.
ANNY_TO_WORLD: Floats = BLENDER_TO_WORLD[:3, :3].copy()
#: (4, 4) from OpenCV camera axes to Blender's and OpenGL's (x right, y up, z backward).
OPENCV_TO_BLENDER_CAMERA: Floats = np.diag([1.0, -1.0, -1.0, 1.0])
#: From axes x left, y up, z forward (PyTorch3D's) to OpenCV's.
_LEFT_UP_FORWARD_TO_OPENCV: Floats = np.diag([-1.0, -1.0, 1.0, 1.0])
#: Cosine of the widest angle between a camera's axis and the origin at which it still faces it.
_FACING_COSINE = 0.5


def rotation_from_quaternion(wxyz: ArrayLike) -> Floats:
    """(3, 3) rotation of a quaternion (w, x, y, z), which is normalised first."""
    quaternion = np.asarray(wxyz, dtype=np.float64)
    length = float(np.linalg.norm(quaternion))
    if quaternion.shape != (4,) or not np.isfinite(length) or length < 1e-9:
        raise DataError("not a quaternion", expected="four finite numbers wxyz", got=str(wxyz))
    w, x, y, z = quaternion / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(rotation: Floats) -> Floats:
    """Unit quaternion (w, x, y, z) with w >= 0 of a (3, 3) rotation.

    The eigenvector of Bar-Itzhack's symmetric matrix: no case distinction, exact for half turns.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation
    K = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    quaternion = np.linalg.eigh(K)[1][:, -1]
    return quaternion if quaternion[0] >= 0 else -quaternion


def camera_to_blender(camera: Camera) -> Floats:
    """(4, 4) Blender ``matrix_world`` of a camera object: its own axes to Blender's world."""
    return rigid_inverse(BLENDER_TO_WORLD) @ camera.camera_to_world @ OPENCV_TO_BLENDER_CAMERA


def read_published_cameras(path: Path) -> tuple[Camera, ...]:
    """Cameras of a ``camera_parameters.json`` as published with MExECON.

    They keep the file's order, which does not start at the front. Among the eight published
    cameras, camera 6 is in front of a subject that faces Blender's -Y, and camera 2 is behind it.
    Lengths are those of the file, in which a scan has its own units.

    Each entry has a Blender location, ``image_size`` as [width, height], and a quaternion
    (w, x, y, z) whose columns are the camera's axes x left, y up, z forward. Files with Blender's
    own camera axes (x right, y up, z backward) are accepted, too. The reader takes the axes with
    which every camera looks towards the origin.

    Raises:
        DataError: not such a file, or a camera that looks away from the origin either way.
    """
    try:
        entries = json.loads(path.read_text(encoding="utf-8-sig"))
        with _located(path):
            parsed = [_published_entry(entry) for entry in entries]
        if not parsed:
            raise ValueError("no cameras")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(
            f"{path} is not a published camera file",
            expected="a JSON list of location, quaternion, focal_length_px, image_size",
            got=f"{type(error).__name__}: {error}",
        ) from error
    for axes_to_opencv in (_LEFT_UP_FORWARD_TO_OPENCV, OPENCV_TO_BLENDER_CAMERA):
        # Both changes of axes are their own inverse.
        with _located(path):
            cameras = tuple(
                Camera(K, rigid_inverse(BLENDER_TO_WORLD @ pose @ axes_to_opencv), width, height)
                for pose, K, width, height in parsed
            )
        if all(map(_faces_origin, cameras)):
            return cameras
    raise DataError(
        f"the cameras in {path} do not face the origin",
        expected="rotations with columns x left, y up, z forward, or Blender's camera axes",
        hint="Check the order of the quaternion (w, x, y, z)",
    )


def _faces_origin(camera: Camera) -> bool:
    distance = float(np.linalg.norm(camera.position))
    return float(-camera.position @ camera.forward) > _FACING_COSINE * distance


def _published_entry(entry: Mapping[str, Any]) -> tuple[Floats, Floats, int, int]:
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_quaternion(entry["quaternion"])
    pose[:3, 3] = entry["location"]
    width, height = (int(side) for side in entry["image_size"])
    focal = float(entry["focal_length_px"])
    return pose, _intrinsics(focal, focal, width / 2, height / 2), width, height


def _intrinsics(fx: float, fy: float, cx: float, cy: float) -> Floats:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


@contextlib.contextmanager
def _located(path: Path) -> Generator[None]:
    """Add the file's path to errors about a camera in it."""
    try:
        yield
    except DataError as error:
        raise error.located(path) from error


def require_perspective(cameras: Sequence[Camera], what: str) -> None:
    """Refuse cameras of a kind that a form of file does not have, or that a step cannot take.

    Args:
        cameras: Of either kind.
        what: What goes on after "camera 0".

    Raises:
        DataError: one of them is orthographic.
    """
    for number, camera in enumerate(cameras):
        if camera.is_orthographic:
            raise DataError(
                f"camera {number} {what}",
                expected="perspective cameras",
                got="an orthographic one",
                hint="Take photos with perspective cameras; the form nerfstudio has both kinds",
            )


def write_transforms_json(path: Path, cameras: Sequence[Camera], images: Sequence[str]) -> None:
    """Write nerfstudio's ``transforms.json``: OpenGL camera-to-world matrices, world with +Z up.

    Orthographic cameras are nerfstudio's ``ORTHOPHOTO``, whose focal lengths are pixels per metre.

    Raises:
        DataError: cameras of both kinds, of which the file has one.
    """
    parallel = {camera.is_orthographic for camera in cameras} == {True}
    if not parallel:
        require_perspective(cameras, "cannot be in one file with perspective ones")
    frames = [
        {
            "file_path": image,
            "fl_x": camera.K[0, 0],
            "fl_y": camera.K[1, 1],
            "cx": camera.K[0, 2],
            "cy": camera.K[1, 2],
            "w": camera.width,
            "h": camera.height,
            "transform_matrix": camera_to_blender(camera).tolist(),
        }
        for camera, image in zip(cameras, images, strict=True)
    ]
    model = "ORTHOPHOTO" if parallel else "OPENCV"
    write_json(path, {"camera_model": model, "frames": frames})


def write_colmap(directory: Path, cameras: Sequence[Camera], images: Sequence[str]) -> None:
    """Write COLMAP's text model, world unchanged: cameras, images, and no points.

    Raises:
        DataError: an orthographic camera, which COLMAP does not have.
    """
    require_perspective(cameras, "cannot be written in COLMAP's form")
    camera_lines: list[str] = []
    image_lines: list[str] = []
    for index, (camera, image) in enumerate(zip(cameras, images, strict=True), start=1):
        K = camera.K
        camera_lines.append(
            f"{index} PINHOLE {camera.width} {camera.height} "
            + _words(K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        )
        pose = _words(*quaternion_from_rotation(camera.rotation), *camera.world_to_camera[:3, 3])
        # The line after each image holds its 2-D points.
        image_lines += [f"{index} {pose} {index} {image}", ""]
    write_text(directory / "cameras.txt", "\n".join(camera_lines) + "\n")
    write_text(directory / "images.txt", "\n".join(image_lines) + "\n")
    write_text(directory / "points3D.txt", "")


def _words(*numbers: float) -> str:
    return " ".join(repr(float(number)) for number in numbers)
