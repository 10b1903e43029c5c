"""The border: cameras of other conventions become ours here, and ours become theirs.

Ours is OpenCV axes (x right, y down, z forward) in a right-handed world with +Y up. Blender's world
has +Z up; its +X becomes our +Z, so that the first camera of the published rig, which stands on
Blender's +X, is our frontal view.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.core.camera import Camera, rigid_inverse
from harness.core.errors import DataError
from harness.core.files import read_json, write_json, write_text

__all__ = [
    "BLENDER_TO_WORLD",
    "OPENCV_TO_BLENDER_CAMERA",
    "camera_from_blender",
    "camera_to_blender",
    "quaternion_from_rotation",
    "read_colmap",
    "read_published_cameras",
    "read_transforms_json",
    "rotation_from_quaternion",
    "write_colmap",
    "write_transforms_json",
]

Floats = NDArray[np.float64]

#: (4, 4) from Blender's world (Z up) to ours (Y up): (x, y, z) becomes (y, z, x).
BLENDER_TO_WORLD: Floats = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
#: (4, 4) from OpenCV camera axes to Blender's and OpenGL's (x right, y up, z backward).
OPENCV_TO_BLENDER_CAMERA: Floats = np.diag([1.0, -1.0, -1.0, 1.0])
#: From axes x left, y up, z forward (PyTorch3D's) to OpenCV's.
_LEFT_UP_FORWARD_TO_OPENCV: Floats = np.diag([-1.0, -1.0, 1.0, 1.0])


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
    """(4, 4) Blender ``matrix_world`` of a camera object: Blender axes to Blender's world, metres."""
    return rigid_inverse(BLENDER_TO_WORLD) @ camera.camera_to_world @ OPENCV_TO_BLENDER_CAMERA


def camera_from_blender(matrix_world: Floats, K: Floats, width: int, height: int) -> Camera:
    """Our camera from a Blender camera object's ``matrix_world`` and its intrinsics in pixels."""
    camera_to_world = BLENDER_TO_WORLD @ np.asarray(matrix_world) @ OPENCV_TO_BLENDER_CAMERA
    return Camera(K=K, world_to_camera=rigid_inverse(camera_to_world), width=width, height=height)


def read_published_cameras(path: Path) -> tuple[Camera, ...]:
    """Cameras of a ``camera_parameters.json`` as published with MExECON.

    Each entry has a Blender location, a quaternion (w, x, y, z) and ``image_size`` as [height,
    width]. Read in Blender's camera axes, the published rotations look *away* from the subject at
    every camera; read as x left, y up, z forward they look at it. Both kinds of file are accepted:
    the axes are those under which the cameras face their common centre.

    Raises:
        DataError: not such a file, or the cameras face their centre under neither reading.
    """
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))
        parsed = [_published_entry(entry) for entry in entries]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(
            f"{path} is not a published camera file",
            expected="a JSON list of location, quaternion, focal_length_px, image_size",
            got=f"{type(error).__name__}: {error}",
        ) from error
    centre = np.mean([pose[:3, 3] for pose, *_ in parsed], axis=0)
    for axes_to_opencv in (OPENCV_TO_BLENDER_CAMERA, _LEFT_UP_FORWARD_TO_OPENCV):
        cameras = tuple(
            Camera(
                K=np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]),
                # Both changes of axes are their own inverse.
                world_to_camera=rigid_inverse(BLENDER_TO_WORLD @ pose @ axes_to_opencv),
                width=width,
                height=height,
            )
            for pose, focal, width, height in parsed
        )
        centre_world = BLENDER_TO_WORLD[:3, :3] @ centre
        if all((centre_world - camera.position) @ camera.forward > 0 for camera in cameras):
            return cameras
    raise DataError(
        f"the cameras in {path} do not face a common centre",
        expected="rotations in Blender axes, or x left, y up, z forward",
        hint="Check the order of the quaternion (w, x, y, z)",
    )


def _published_entry(entry: dict[str, object]) -> tuple[Floats, float, int, int]:
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_quaternion(entry["quaternion"])  # type: ignore[arg-type]
    pose[:3, 3] = entry["location"]
    height, width = (int(side) for side in entry["image_size"])  # type: ignore[attr-defined]
    return pose, float(entry["focal_length_px"]), width, height  # type: ignore[arg-type]


def write_transforms_json(path: Path, cameras: Sequence[Camera], images: Sequence[str]) -> None:
    """Write nerfstudio's ``transforms.json``: OpenGL camera-to-world matrices, world with +Z up."""
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
    write_json(path, {"camera_model": "OPENCV", "frames": frames})


def read_transforms_json(path: Path) -> tuple[tuple[Camera, ...], tuple[str, ...]]:
    """Cameras and image names of a nerfstudio ``transforms.json``.

    Intrinsics may stand once for all frames or in each. Distortion is refused, not dropped.
    """
    document = read_json(path)
    cameras, images = [], []
    try:
        for frame in document["frames"]:  # type: ignore[attr-defined]
            values = {**document, **frame}
            bent = [key for key in ("k1", "k2", "k3", "k4", "p1", "p2") if values.get(key)]
            if bent:
                raise DataError(
                    f"{path} has lens distortion ({', '.join(bent)})",
                    hint="Undistort the images first; a pinhole camera cannot carry it",
                )
            K = np.array(
                [
                    [values["fl_x"], 0, values["cx"]],
                    [0, values.get("fl_y", values["fl_x"]), values["cy"]],
                    [0, 0, 1],
                ]
            )
            matrix = np.array(frame["transform_matrix"], dtype=np.float64)
            cameras.append(camera_from_blender(matrix, K, int(values["w"]), int(values["h"])))
            images.append(str(frame["file_path"]))
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"{path} is not a nerfstudio transforms.json", got=f"{type(error).__name__}: {error}"
        ) from error
    return tuple(cameras), tuple(images)


def write_colmap(directory: Path, cameras: Sequence[Camera], images: Sequence[str]) -> None:
    """Write COLMAP's ``cameras.txt``, ``images.txt`` and an empty ``points3D.txt``; world unchanged."""
    camera_lines, image_lines = [], []
    for index, (camera, image) in enumerate(zip(cameras, images, strict=True), start=1):
        fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
        camera_lines.append(
            f"{index} PINHOLE {camera.width} {camera.height} {fx!r} {fy!r} {cx!r} {cy!r}"
        )
        pose = [*quaternion_from_rotation(camera.rotation), *camera.world_to_camera[:3, 3]]
        image_lines += [f"{index} {' '.join(repr(float(x)) for x in pose)} {index} {image}", ""]
    write_text(directory / "cameras.txt", "\n".join(camera_lines) + "\n")
    write_text(directory / "images.txt", "\n".join(image_lines) + "\n")
    write_text(directory / "points3D.txt", "")


def read_colmap(directory: Path) -> tuple[tuple[Camera, ...], tuple[str, ...]]:
    """Cameras and image names of a COLMAP text model, in order of image id; world unchanged."""
    try:
        intrinsics = {}
        for line in _colmap_lines(directory / "cameras.txt"):
            identifier, model, width, height, *parameters = line.split()
            K = _colmap_K(model, parameters, directory)
            intrinsics[identifier] = (K, int(width), int(height))
        found = []
        # Every second line holds the image's 2-D points, and may be empty.
        for line in _colmap_lines(directory / "images.txt", keep_empty=True)[::2]:
            image_id, *pose, camera_id, name = line.split(maxsplit=9)
            numbers = np.array(pose, dtype=np.float64)
            extrinsic = np.eye(4)
            extrinsic[:3, :3] = rotation_from_quaternion(numbers[:4])
            extrinsic[:3, 3] = numbers[4:]
            K, width, height = intrinsics[camera_id]
            found.append((int(image_id), Camera(K, extrinsic, width, height), name))
    except (OSError, ValueError, KeyError) as error:
        raise DataError(
            f"{directory} is not a COLMAP text model",
            expected="cameras.txt and images.txt",
            got=f"{type(error).__name__}: {error}",
        ) from error
    found.sort(key=lambda entry: entry[0])
    return tuple(camera for _, camera, _ in found), tuple(name for *_, name in found)


def _colmap_lines(path: Path, *, keep_empty: bool = False) -> list[str]:
    lines = [
        line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")
    ]
    return lines if keep_empty else [line for line in lines if line.strip()]


def _colmap_K(model: str, parameters: list[str], directory: Path) -> Floats:
    numbers = [float(text) for text in parameters]
    if model == "SIMPLE_PINHOLE":
        fx, cx, cy = numbers
        fy = fx
    elif model == "PINHOLE":
        fx, fy, cx, cy = numbers
    else:
        raise DataError(
            f"{directory / 'cameras.txt'} has a camera of model {model}",
            expected="PINHOLE or SIMPLE_PINHOLE",
            hint="Undistort the images with COLMAP's image_undistorter first",
        )
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
