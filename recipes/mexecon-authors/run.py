"""MExECON as its authors wrote it, on eight photos; its mesh is in the first one's cube.

run.py --photos FOLDER --out mesh.obj --checkout MExECON --loop 35
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import exchange

#: Blender's world (+Z up, the subject faces -Y) from this one (+Y up, it faces +Z).
_TO_BLENDER = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=float)
#: The published files' camera axes are x left, y up, z forward.
_AXES = np.diag([-1.0, -1.0, 1.0])
_SENSOR_MM = 36.0


def camera_entry(number: int, photo: exchange.Photo) -> dict:
    """A camera as ``camera_parameters.json`` has it."""
    turn = photo.world_to_camera[:3, :3]
    axes = _TO_BLENDER @ turn.T @ _AXES
    place = _TO_BLENDER @ (-turn.T @ photo.world_to_camera[:3, 3])
    return {
        "frame": number,
        "location": place.tolist(),
        "quaternion": exchange.quaternion(axes).tolist(),
        "focal_length_px": float(photo.intrinsics[0, 0]),
        "sensor_width": _SENSOR_MM,
        "image_size": list(photo.rgba.shape[1::-1]),
    }


def main() -> None:
    """Run the program, bring its mesh to metres."""
    asked = exchange.arguments("checkout", "loop")
    photos = exchange.read_photos(asked.photos)
    with tempfile.TemporaryDirectory(dir=str(asked.out.parent)) as name:
        place = Path(name)
        (place / "in" / "cam_params").mkdir(parents=True)
        for number, photo in enumerate(photos):
            shutil.copyfile(photo.path, place / "in" / f"frame_{number:04d}.png")
        entries = [camera_entry(number, photo) for number, photo in enumerate(photos)]
        (place / "in" / "cam_params" / "camera_parameters.json").write_text(json.dumps(entries))
        words = [sys.executable, "-m", "apps.infer", "-cfg", "./configs/econ.yaml"]
        words += ["-in_dir", str(place / "in"), "-out_dir", str(place / "out")]
        words += ["-loop_smpl", asked.loop, "-front_view", "0", "-back_view", str(len(photos) // 2)]
        exchange.run(words, Path(asked.checkout))
        move = exchange.cube_in_world(
            exchange.econ_cube_to_photo(place / "out"),
            photos[0],
            exchange.subject_centre(asked.photos),
        )
        exchange.copied_obj(exchange.last_file(place / "out", "*_full.obj"), asked.out, move)


if __name__ == "__main__":
    main()
