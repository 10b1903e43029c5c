"""What the programs of recipes share: photos in, a result out. numpy and Pillow alone.

Each recipe's ``run.py`` puts this folder on its path. Any Python from 3.8 on.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

#: OpenCV's camera axes (y down, z forward) from nerfstudio's (y up, z backward).
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
#: ECON's crop has so many pixels, over which its cube goes from -1 to 1.
_CROP_PX = 512


class Photo(NamedTuple):
    """A photo as it is given.

    Attributes:
        path: Its file.
        rgba: (H, W, 4) uint8; alpha is coverage, 255 where no mask is given.
        intrinsics: (3, 3) pixels, the first pixel's middle at 0.5; None without cameras.
        world_to_camera: (4, 4) metres, OpenCV's axes; None without cameras.
    """

    path: Path
    rgba: np.ndarray
    intrinsics: np.ndarray | None
    world_to_camera: np.ndarray | None


class Fitted(NamedTuple):
    """A photo as a network sees it.

    Attributes:
        picture: (H, W, 3) uint8.
        resized: Width and height that the whole photo was resized to.
        shift: Where its left and top edges are; negative where they are cut off.
    """

    picture: np.ndarray
    resized: tuple[int, int]
    shift: tuple[int, int]

    def intrinsics(self, photo: Photo) -> np.ndarray:
        """(3, 3) of the photo's camera, on the picture's pixels."""
        height, width = photo.rgba.shape[:2]
        scale = np.array([self.resized[0] / width, self.resized[1] / height])
        found = np.array(photo.intrinsics, dtype=np.float64)
        found[:2] *= scale[:, None]
        found[:2, 2] += self.shift
        return found


def refuse(reason: str) -> None:
    """End, and say in a sentence why."""
    raise SystemExit(f"refused: {reason}")


def arguments(*more: str) -> argparse.Namespace:
    """``--photos``, ``--out`` and further options, all of them text."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    for name in more:
        parser.add_argument(f"--{name}", required=True)
    return parser.parse_args()


def read_photos(folder: Path) -> list[Photo]:
    """The photos in the order in which they were asked for."""
    names = json.loads((folder / "request.json").read_text())["images"]
    cameras = {}
    if (folder / "transforms.json").is_file():
        for frame in json.loads((folder / "transforms.json").read_text())["frames"]:
            K = [[frame["fl_x"], 0, frame["cx"]], [0, frame["fl_y"], frame["cy"]], [0, 0, 1]]
            pose = np.array(frame["transform_matrix"]) @ _FLIP
            cameras[frame["file_path"]] = np.array(K, dtype=np.float64), np.linalg.inv(pose)
    found = []
    for name in names:
        with Image.open(folder / name) as image:
            rgba = np.asarray(image.convert("RGBA"))
        found.append(Photo(folder / name, rgba, *cameras.get(name, (None, None))))
    return found


def over(rgba: np.ndarray, background: int) -> Image.Image:
    """A photo over a plain grey."""
    ground = Image.new("RGBA", rgba.shape[1::-1], (background, background, background, 255))
    return Image.alpha_composite(ground, Image.fromarray(np.ascontiguousarray(rgba))).convert("RGB")


def fitted(rgba: np.ndarray, side: int, patch: int, fit: str, background: int) -> Fitted:
    """A photo over a plain grey for a network with square patches; bicubic, as Pillow does it.

    Args:
        rgba: (h, w, 4) uint8.
        side: Longest side of the picture; with ``crop`` its width.
        patch: Both sides of the picture are multiples of this.
        fit: ``pad`` shows all of it on a square, ``fit`` without the padding; ``crop`` fills the
            width and cuts what is taller than the square.
        background: 0 to 255, also of the padding.
    """
    height, width = rgba.shape[:2]
    if fit == "crop" or width >= height:
        resized = side, _multiple(height * (side / width), patch)
    else:
        resized = _multiple(width * (side / height), patch), side
    if fit == "crop":
        size, shift = (side, min(resized[1], side)), (0, -(max(resized[1] - side, 0) // 2))
    elif fit == "fit":
        size, shift = resized, (0, 0)
    elif fit == "pad":
        size, shift = (side, side), ((side - resized[0]) // 2, (side - resized[1]) // 2)
    else:
        refuse(f"network.fit must be pad, fit or crop, not '{fit}'")
    canvas = Image.new("RGB", size, (background, background, background))
    canvas.paste(over(rgba, background).resize(resized, Image.BICUBIC), shift)
    return Fitted(np.asarray(canvas), resized, shift)


def _multiple(length: float, patch: int) -> int:
    # Python's round, half to even, as the networks' own code has it.
    return max(patch, round(length / patch) * patch)


def fitted_all(photos: list[Photo], side: int, patch: int, fit: str, background: int) -> list:
    """All photos, in pictures of one size."""
    found = [fitted(photo.rgba, side, patch, fit, background) for photo in photos]
    if len({each.picture.shape for each in found}) > 1:
        refuse(f"photos of several sizes cannot be shown with network.fit={fit}, but with pad")
    return found


def device_of(asked: str, torch) -> str:  # noqa: ANN001 - nothing of it is imported here
    """``cuda`` or ``cpu``, for ``auto``, ``cuda`` or ``cpu``."""
    there = torch.cuda.is_available()
    if asked == "cuda" and not there:
        refuse("device 'cuda' was asked for, and this torch sees none")
    return "cuda" if there and asked != "cpu" else "cpu"


def costs(device: str, torch, start: float, loaded: float) -> dict[str, object]:  # noqa: ANN001
    """What a network ran on, and how long it took to load and, until now, to run."""
    return {
        "device": device,
        "torch": torch.__version__,
        "load_s": round(loaded - start, 2),
        "run_s": round(time.perf_counter() - loaded, 2),
    }


def write_depth(
    out: Path,
    arrays: dict[str, np.ndarray],
    report: dict[str, object],
    pictures: list[Fitted] | None = None,
) -> None:
    """Write depth maps with cameras, and what a reader of the record should know.

    Args:
        out: The file.
        arrays: ``depth`` (S, H, W), ``intrinsics`` (S, 3, 3), ``world_to_camera`` (S, 4, 4), and
            ``confidence`` (S, H, W) where there is one.
        report: Plain JSON values.
        pictures: What was shown, if that is not whole photos.
    """
    frames = {}
    if pictures is not None:
        frames["resized"] = np.array([each.resized for each in pictures])
        frames["shift"] = np.array([each.shift for each in pictures])
    np.savez(out, **arrays, **frames)
    write_report(out, report)


def write_report(out: Path, report: dict[str, object]) -> None:
    """Tell a reader of the record something."""
    (out.parent / "report.json").write_text(json.dumps(report))


def whole(moves: np.ndarray) -> np.ndarray:
    """(S, 4, 4) of transforms (S, 3, 4) or (S, 4, 4)."""
    found = np.tile(np.eye(4), (len(moves), 1, 1))
    found[:, :3] = np.asarray(moves, dtype=np.float64)[:, :3]
    return found


def run(words: list[str], folder: Path) -> None:
    """Run a command of the method's own checkout; end with what it said, if it fails."""
    sys.stdout.flush()
    status = subprocess.run(words, cwd=folder, check=False).returncode
    if status:
        raise SystemExit(f"{' '.join(words[:3])} ended with exit status {status}")


def last_file(folder: Path, pattern: str) -> Path:
    """The file of a pattern that a method wrote, the last one by name."""
    found = sorted(folder.rglob(pattern))
    if not found:
        refuse(f"the method wrote no {pattern}")
    return found[-1]


def subject_centre(folder: Path) -> np.ndarray:
    """(3,) metres: the middle of the subject, which tells how far away it is."""
    return np.array(json.loads((folder / "request.json").read_text())["subject_centre_m"])


def copied_obj(source: Path, out: Path, move=None) -> None:  # noqa: ANN001 - a function of points
    """Write the surface of an OBJ file, its vertices moved by a function of (V, 3)."""
    lines = source.read_text().splitlines()
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], dtype=float)
    faces = [[w.split("/")[0] for w in line.split()[1:]] for line in lines if line[:2] == "f "]
    vertices = vertices if move is None else move(vertices)
    rows = ["v {!r} {!r} {!r}".format(*row) for row in vertices.tolist()]
    out.write_text("\n".join(rows + [f"f {' '.join(face)}" for face in faces]) + "\n")


def cube_in_world(to_photo: np.ndarray, photo: Photo, centre: np.ndarray):  # noqa: ANN201
    """A function from a method's cube (V, 3) to metres in the world.

    The cube is what an orthographic camera sees: x right, y up, z towards the viewer. It stands
    where the subject does, as large as it looks from there; it is turned and scaled, and no
    perspective is put into it.

    Args:
        to_photo: (3, 3) from x, y, 1 of the cube to pixels of the photo.
        photo: The photo, with its camera.
        centre: (3,) the subject's middle, metres.
    """
    K, move = photo.intrinsics, photo.world_to_camera
    away = (move[:3, :3] @ centre + move[:3, 3])[2]
    per_unit = np.sqrt(abs(np.linalg.det(to_photo[:2, :2]))) * away / K[0, 0]

    def moved(points: np.ndarray) -> np.ndarray:
        flat = np.column_stack([points[:, :2], np.ones(len(points))])
        ray = flat @ (np.linalg.inv(K) @ to_photo).T
        seen = np.column_stack([away * ray[:, :2], away - per_unit * points[:, 2]])
        return (seen - move[:3, 3]) @ move[:3, :3]

    return moved


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """w, x, y, z of a rotation: the largest eigenvector of Bar-Itzhack's matrix."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    matrix = [
        [a + e + i, h - f, c - g, d - b],
        [h - f, a - e - i, b + d, c + g],
        [c - g, b + d, e - a - i, f + h],
        [d - b, c + g, f + h, i - a - e],
    ]
    found = np.linalg.eigh(np.array(matrix))[1][:, -1]
    return found * (1.0 if found[0] >= 0 else -1.0)


def econ_cube_to_photo(folder: Path) -> np.ndarray:
    """(3, 3) from ECON's cube to pixels of the photo, by the crop that ECON noted in a folder.

    Its two affine maps count pixels by their middles; here the first one's middle is at 0.5.
    """
    import torch

    # Written by the program that just ran here, with arrays of numpy in it.
    path = last_file(folder, "*_in_tensor.pt")
    noted = torch.load(path, map_location="cpu", weights_only=False)
    steps = [_square(noted["uncrop_param"][name]) for name in ("M_crop", "M_square")]
    half = _CROP_PX / 2
    to_crop = np.array([[half, 0, half - 0.5], [0, -half, half - 0.5], [0, 0, 1]])
    to_middle = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
    return to_middle @ np.linalg.inv(steps[0] @ steps[1]) @ to_crop


def _square(affine) -> np.ndarray:  # noqa: ANN001 - an array or a tensor, perhaps of several people
    rows = np.asarray(affine, dtype=np.float64).reshape(-1, np.shape(affine)[-1])[:2]
    return np.vstack([rows, [0, 0, 1]])
