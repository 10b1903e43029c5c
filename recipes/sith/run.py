"""SiTH as its authors wrote it, on the frontal photo in the square that it asks for.

run.py --photos FOLDER --out mesh.obj --checkout SiTH --openpose PROGRAM --fill 0.85 --seed 0
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import exchange

_SIDE_PX = 1024


def squared(rgba: np.ndarray, fill: float) -> tuple:
    """The person in the middle of a square picture, and (3, 3) from SiTH's cube to the photo."""
    rows, columns = (np.flatnonzero((rgba[..., 3] > 0).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        exchange.refuse("the photo's mask is empty")
    low = np.array([columns[0], rows[0]], dtype=float)
    high = np.array([columns[-1], rows[-1]], dtype=float) + 1
    # Photo pixels per pixel of the square.
    scale = (high - low).max() / (fill * _SIDE_PX)
    corner = (low + high) / 2 - scale * _SIDE_PX / 2
    box = (scale, 0, corner[0], 0, scale, corner[1])
    image = Image.fromarray(np.ascontiguousarray(rgba))
    picture = image.transform((_SIDE_PX, _SIDE_PX), Image.AFFINE, box, Image.BICUBIC)
    half = _SIDE_PX / 2
    to_square = np.array([[half, 0, half], [0, -half, half], [0, 0, 1]])
    return picture, np.array([[scale, 0, corner[0]], [0, scale, corner[1]], [0, 0, 1]]) @ to_square


def main() -> None:
    """Run the program's steps, bring its mesh to metres."""
    asked = exchange.arguments("checkout", "openpose", "fill", "seed")
    (photo,) = exchange.read_photos(asked.photos)
    picture, to_photo = squared(photo.rgba, float(asked.fill))
    checkout, python = Path(asked.checkout), sys.executable
    with tempfile.TemporaryDirectory(dir=str(asked.out.parent)) as name:
        place = Path(name)
        images = place / "images"
        images.mkdir()
        picture.save(images / "000.png")
        words = [asked.openpose, "--image_dir", str(images), "--write_json", str(images)]
        words += ["--display", "0", "--net_resolution", "-1x544", "--scale_number", "3"]
        words += ["--scale_gap", "0.25", "--hand", "--face", "--render_pose", "0"]
        exchange.run(words, checkout)
        words = [python, "fit.py", "-i", str(images), "-o", str(place / "smplx")]
        exchange.run([*words, "--opt_orient", "--opt_betas"], checkout)
        words = [python, "hallucinate.py", "-i", str(place), "-o", str(place / "back_images")]
        # It takes seeds of 32 bits.
        words += ["--num_validation_images", "8", "--seed", str(int(asked.seed) % 2**32)]
        exchange.run(words, checkout)
        words = [python, "reconstruct.py", "--test-folder", str(place)]
        words += ["--config", "recon/config.yaml", "--resume", "checkpoints/recon_model.pth"]
        exchange.run(words, checkout)
        move = exchange.cube_in_world(to_photo, photo, exchange.subject_centre(asked.photos))
        exchange.copied_obj(exchange.last_file(place / "meshes", "*.obj"), asked.out, move)


if __name__ == "__main__":
    main()
