"""2D Gaussian Splatting as its authors wrote it, on photos and cameras as COLMAP would have them.

run.py --photos FOLDER --out gaussians.ply --checkout 2DGS --iterations 30000 --ratio 1
--start 20000 --seed 0
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import exchange

#: Half of the block that the first points are in, metres, about the subject's middle; and how many
#: times they may be thrown.
_HALF_M, _THROWS = (0.9, 1.2, 0.9), 60


def start_points(photos: list, centre: np.ndarray, count: int, seed: int) -> tuple:
    """Points (N, 3) inside all masks, and their colours (N, 3) uint8 in the first photo."""
    rng = np.random.default_rng(seed)
    points, colours = np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    for _ in range(_THROWS):
        thrown = centre + rng.uniform(-1, 1, (count, 3)) * _HALF_M
        inside, seen = np.ones(count, dtype=bool), None
        for photo in photos:
            ahead = thrown @ photo.world_to_camera[:3, :3].T + photo.world_to_camera[:3, 3]
            pixel = ahead @ photo.intrinsics.T
            place = np.floor(pixel[:, :2] / np.maximum(pixel[:, 2:], 1e-9)).astype(int)
            height, width = photo.rgba.shape[:2]
            framed = (
                (ahead[:, 2] > 0) & (place >= 0).all(axis=1) & (place < (width, height)).all(axis=1)
            )
            x, y = np.where(framed[:, None], place, 0).T
            inside &= framed & (photo.rgba[y, x, 3] >= 128)
            seen = photo.rgba[y, x, :3] if seen is None else seen
        points = np.concatenate([points, thrown[inside]])
        colours = np.concatenate([colours, seen[inside]])
        if len(points) >= count:
            break
    if not len(points):
        exchange.refuse("no point is inside all masks")
    return points[:count], colours[:count]


def write_scene(folder: Path, photos: list, points: np.ndarray, colours: np.ndarray) -> None:
    """COLMAP's text model with pictures on white."""
    model = folder / "sparse" / "0"
    (folder / "images").mkdir(parents=True)
    model.mkdir(parents=True)
    cameras, images = [], []
    for number, photo in enumerate(photos, start=1):
        K, (height, width) = photo.intrinsics, photo.rgba.shape[:2]
        name = f"{number:03d}.png"
        exchange.over(photo.rgba, 255).save(folder / "images" / name)
        words = [width, height, *K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()]
        cameras.append(f"{number} PINHOLE {' '.join(map(str, words))}")
        pose = [*exchange.quaternion(photo.world_to_camera[:3, :3]), *photo.world_to_camera[:3, 3]]
        images += [f"{number} {' '.join(str(float(v)) for v in pose)} {number} {name}", ""]
    rows = [
        f"{number} {' '.join(map(repr, point))} {' '.join(map(str, colour))} 1.0"
        for number, (point, colour) in enumerate(zip(points.tolist(), colours.tolist()), start=1)  # noqa: B905
    ]
    for name, lines in (("cameras", cameras), ("images", images), ("points3D", rows)):
        (model / f"{name}.txt").write_text("\n".join(lines) + "\n")


def main() -> None:
    """Train, hand the Gaussians on."""
    asked = exchange.arguments("checkout", "iterations", "ratio", "start", "seed")
    photos = exchange.read_photos(asked.photos)
    centre = exchange.subject_centre(asked.photos)
    # It takes seeds of 32 bits.
    points, colours = start_points(photos, centre, int(asked.start), int(asked.seed) % 2**32)
    with tempfile.TemporaryDirectory(dir=str(asked.out.parent)) as name:
        place = Path(name)
        write_scene(place / "scene", photos, points, colours)
        words = [sys.executable, "train.py", "-s", str(place / "scene"), "-m", str(place / "out")]
        words += ["--white_background", "--iterations", asked.iterations]
        words += ["--depth_ratio", asked.ratio, "--save_iterations", asked.iterations]
        exchange.run(words, Path(asked.checkout))
        made = place / "out" / "point_cloud" / f"iteration_{asked.iterations}" / "point_cloud.ply"
        if not made.is_file():
            exchange.refuse(f"the program wrote no {made.relative_to(place)}")
        shutil.copyfile(made, asked.out)


if __name__ == "__main__":
    main()
