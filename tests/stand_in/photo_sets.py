"""Photo sets of the field as their users unpack them, of any cameras and pictures."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from harness.core.camera import Camera
from tests.stand_in.field_trees import put_pickle

#: k1, k2, p1, p2, k3 of the sets that have a lens.
LENS = (0.02, -0.01, 0.001, -0.0005, 0.003)
FRAME = 5


def put_picture(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, quality=95)


def opencv(K: np.ndarray) -> np.ndarray:
    """K where the middle of the top-left pixel is 0."""
    moved = np.array(K)
    moved[:2, 2] -= 0.5
    return moved


def put_photos(root: Path, photo: str, mask: str, views, frame=FRAME) -> None:
    for number, (_, rgb, alpha) in enumerate(views):
        put_picture(root / photo.format(n=number, f=frame), rgb)
        put_picture(root / mask.format(n=number, f=frame), alpha)
        # Another frame, and one that does not count.
        put_picture(root / photo.format(n=number, f=frame + 1), rgb)


Views = Sequence[tuple[Camera, np.ndarray, np.ndarray]]


def mvhumannet(root: Path, views: Views) -> None:
    """Cameras of twice the size of the photos, millimetres over a factor."""
    put_photos(root, "images/CC0{n}/{f:04d}_img.jpg", "fmask/CC0{n}/{f:04d}_img_fmask.png", views)
    camera, scale = views[0][0], 120 / 65
    K = camera.resized(2 * camera.width, 2 * camera.height).K
    (root / "camera_intrinsics.json").write_text(
        json.dumps({"intrinsics": opencv(K).tolist(), "dist": []}))  # fmt: skip
    entries = {
        f"1_CC0{n}.png": {
            "rotation": np.round(camera.rotation, 9).tolist(),
            "translation": (camera.world_to_camera[:3, 3] * 1000 / scale).tolist(),
        }
        for n, (camera, *_) in enumerate(views)
    }
    (root / "camera_extrinsics.json").write_text(json.dumps(entries))
    put_pickle(root / "camera_scale.pkl", scale)


def mvhumannet_plus(root: Path, views: Views) -> None:
    put_photos(root, "images/cam_0{n}/{f:04d}.jpg", "masks/cam_0{n}/{f:04d}.png", views)
    for n, (camera, *_) in enumerate(views):
        place = root / f"cameras/cam_0{n}"
        place.mkdir(parents=True)
        np.savez(place / "camera.npz", intrinsic=opencv(camera.K).astype(np.float32),
                 extrinsic=camera.world_to_camera[:3])  # fmt: skip


def actorshq(root: Path, views: Views) -> None:
    put_photos(root, "rgbs/Cam00{n}/Cam00{n}_rgb{f:06d}.jpg",
               "masks/Cam00{n}/Cam00{n}_mask{f:06d}.png", views)  # fmt: skip
    names = ["name", "w", "h", "rx", "ry", "rz", "tx", "ty", "tz", "fx", "fy", "px", "py"]
    with (root / "calibration.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(names)
        for n, (camera, *_) in enumerate(views):
            pose = camera.camera_to_world
            size = np.array(camera.size)
            K = camera.K
            turn = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
            focal, middle = K[[0, 1], [0, 1]] / size, K[:2, 2] / size
            row = [*camera.size, *turn, *pose[:3, 3], *focal, *middle]
            writer.writerow([f"Cam00{n}", *row])


def dna(root: Path, views: Views) -> None:
    import h5py

    def encoded(pixels: np.ndarray, form: str) -> np.ndarray:
        out = io.BytesIO()
        Image.fromarray(pixels).save(out, form, quality=95)
        return np.frombuffer(out.getvalue(), np.uint8)

    root.mkdir(parents=True)
    with (
        h5py.File(root / "0012_11.smc", "w") as main,
        h5py.File(root / "0012_11_annots.smc", "w") as annots,
    ):
        for n, (camera, rgb, alpha) in enumerate(views):
            main[f"Camera_5mp/{n}/color/{FRAME}"] = encoded(rgb, "JPEG")
            annots[f"Mask/{n}/mask/{FRAME}"] = encoded(np.dstack([alpha] * 3), "PNG")
            annots[f"Camera_Parameter/{n:02d}/K"] = opencv(camera.K)
            annots[f"Camera_Parameter/{n:02d}/D"] = np.array(LENS)
            annots[f"Camera_Parameter/{n:02d}/RT"] = camera.camera_to_world


def humman(root: Path, views: Views) -> None:
    put_photos(root, "kinect_color/kinect_00{n}/{f:06d}.png",
               "kinect_mask_manual/kinect_00{n}/{f:06d}.png", views)  # fmt: skip
    entries = {
        f"kinect_{kind}_00{n}": {
            "K": opencv(camera.K).tolist(),
            "R": camera.rotation.tolist(),
            "T": camera.world_to_camera[:3, 3].tolist(),
        }
        for n, (camera, *_) in enumerate(views)
        for kind in ("color", "depth")
    }
    (root / "cameras.json").write_text(json.dumps(entries))


def opencv_yaml(path: Path, names: Sequence[str], matrices: dict[str, np.ndarray]) -> None:
    lines = ["%YAML:1.0", "---", "names:", *(f'  - "{name}"' for name in names)]
    for key, matrix in matrices.items():
        values = ", ".join(f"{value:.9f}" for value in matrix.ravel())
        lines += [f"{key}: !!opencv-matrix", f"  rows: {matrix.shape[0]}",
                  f"  cols: {matrix.shape[1]}", "  dt: d", f"  data: [{values}]"]  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\r\n".join(lines) + "\r\n")


def easymocap(root: Path, views: Views, photo="images/{n}/{f:06d}.jpg",
              mask="mask/{n}/{f:06d}.png") -> None:  # fmt: skip
    put_photos(root, photo, mask, views)
    names = [str(n) for n in range(len(views))]
    inner, outer = {}, {}
    for n, (camera, *_) in enumerate(views):
        inner |= {f"K_{n}": opencv(camera.K), f"dist_{n}": np.array([LENS])}
        turn = Rotation.from_matrix(camera.rotation).as_rotvec()
        outer |= {f"R_{n}": turn[:, None], f"Rot_{n}": camera.rotation,
                  f"T_{n}": camera.world_to_camera[:3, 3:]}  # fmt: skip
    opencv_yaml(root / "intri.yml", names, inner)
    opencv_yaml(root / "extri.yml", names, outer)


def zju(root: Path, views: Views) -> None:
    easymocap(root, views, "Camera_B{n}/{f:06d}.jpg", "mask_cihp/Camera_B{n}/{f:06d}.png")


def dress(root: Path, views: Views) -> None:
    put_photos(root, "Capture/000{n}/images/capture-f{f:05d}.png",
               "Capture/000{n}/masks/mask-f{f:05d}.png", views)  # fmt: skip
    put_pickle(root / "Capture/cameras.pkl", {
        f"000{n}": {"intrinsics": camera.K, "extrinsics": camera.world_to_camera[:3]}
        for n, (camera, *_) in enumerate(views)
    })  # fmt: skip


#: By name; whether there is a lens.
SETS: dict[str, tuple[Callable[[Path, Views], None], bool]] = {
    "mvhumannet": (mvhumannet, False),
    "mvhumannet++": (mvhumannet_plus, False),
    "actorshq": (actorshq, False),
    "dna": (dna, True),
    "humman": (humman, False),
    "zju": (zju, True),
    "easymocap": (easymocap, True),
    "4d-dress": (dress, False),
}
