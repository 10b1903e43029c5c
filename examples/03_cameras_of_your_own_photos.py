"""Read camera files of other tools, and check that points land on the right pixels.

Run:   python examples/03_cameras_of_your_own_photos.py
       python examples/03_cameras_of_your_own_photos.py PATH   (lists the cameras of your own file)

PATH is a COLMAP model (a folder with cameras and images, .txt or .bin), a transforms.json of
nerfstudio, or a camera_parameters.json as published with MExECON.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from harness import (
    BLENDER_TO_WORLD,
    Camera,
    RingRig,
    camera_yaw_deg,
    quaternion_from_rotation,
    read_cameras,
    write_colmap,
    write_transforms_json,
)

#: World metres: the corners of a box as large as a person.
POINTS = np.array([[x, y, z] for x in (-0.4, 0.4) for y in (-0.9, 0.9) for z in (-0.2, 0.2)])


def cameras_of(path: Path) -> list[Camera]:
    """The cameras in a file of any of the three kinds; where +Z is up in it, +Y is up here."""
    found = read_cameras(path)
    to_world = BLENDER_TO_WORLD if found.layout in ("nerfstudio", "published") else np.eye(4)
    return [view.camera.in_frame(to_world) for view in found.views]


def write_published(path: Path, cameras: Sequence[Camera]) -> None:
    """Write cameras as the authors of MExECON do: Blender's world, axes x left, y up, z forward."""
    entries = []
    for camera in cameras:
        pose = BLENDER_TO_WORLD.T @ camera.camera_to_world @ np.diag([-1.0, -1.0, 1.0, 1.0])
        entries.append(
            {
                "location": pose[:3, 3].tolist(),
                "quaternion": quaternion_from_rotation(pose[:3, :3]).tolist(),
                "focal_length_px": camera.K[0, 0],
                "image_size": [camera.width, camera.height],
            }
        )
    path.write_text(json.dumps(entries), encoding="utf-8")


def reprojection_error_px(cameras: Sequence[Camera], truth: Sequence[Camera]) -> float:
    """The largest distance between where two sets of cameras see the same points, pixels."""
    differences = [
        read.project(POINTS)[0] - true.project(POINTS)[0]
        for read, true in zip(cameras, truth, strict=True)
    ]
    return float(np.linalg.norm(np.concatenate(differences), axis=1).max())


def list_cameras(cameras: Sequence[Camera]) -> None:
    """Print where each camera stands. In our world the front is +Z, at yaw 0."""
    for index, camera in enumerate(cameras):
        x, y, z = camera.position
        print(
            f"  camera {index}: {camera.width} x {camera.height} pixels,"
            f" focal length {camera.K[0, 0]:.1f} px,"
            f" position ({x:+.2f}, {y:+.2f}, {z:+.2f}), yaw {camera_yaw_deg(camera):5.1f}°"
        )


def main() -> None:
    """Write four known cameras in each format, read them back, and compare the pixels."""
    if len(sys.argv) > 1:
        list_cameras(cameras_of(Path(sys.argv[1])))
        return
    truth = RingRig(views=4).cameras(1080, 1920)
    print("Four cameras on a ring of 3 m:")
    list_cameras(truth)
    names = [f"{index:02d}.png" for index in range(4)]
    with tempfile.TemporaryDirectory() as name:
        colmap, nerfstudio = Path(name, "colmap"), Path(name, "transforms.json")
        published = Path(name, "camera_parameters.json")
        colmap.mkdir()
        write_colmap(colmap, truth, names)
        write_transforms_json(nerfstudio, truth, names)
        write_published(published, truth)
        print("\nLargest reprojection error after writing and reading:")
        for title, path in (
            ("COLMAP", colmap),
            ("nerfstudio", nerfstudio),
            ("published", published),
        ):
            error_px = reprojection_error_px(cameras_of(path), truth)
            print(f"  {title:10} {error_px:.6f} px")

    # The usual mistake: camera axes of OpenGL (y up, z backward) taken for those of OpenCV.
    wrong = [camera.turned(np.diag([1.0, -1.0, -1.0])) for camera in truth]
    depths = np.concatenate([camera.project(POINTS)[1] for camera in wrong])
    behind = (depths <= 0).mean()
    print("\nWith OpenGL axes taken for those of OpenCV,")
    print(f"{behind:.0%} of the points lie behind the cameras.")
    print("If that happens to your file, its axes are not those of its format.")


if __name__ == "__main__":
    main()
