"""ECON as its authors wrote it, on the frontal photo; its mesh comes back by ECON's own crop.

run.py --photos FOLDER --out mesh.obj --checkout ECON --loop 50
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import exchange


def main() -> None:
    """Run the program, bring its mesh to metres."""
    asked = exchange.arguments("checkout", "loop")
    (photo,) = exchange.read_photos(asked.photos)
    with tempfile.TemporaryDirectory(dir=str(asked.out.parent)) as name:
        place = Path(name)
        (place / "in").mkdir()
        shutil.copyfile(photo.path, place / "in" / "photo.png")
        words = [sys.executable, "-m", "apps.infer", "-cfg", "./configs/econ.yaml"]
        words += ["-in_dir", str(place / "in"), "-out_dir", str(place / "out")]
        # Without -novis: the crop is in the file that the pictures are made from.
        exchange.run([*words, "-loop_smpl", asked.loop], Path(asked.checkout))
        move = exchange.cube_in_world(
            exchange.econ_cube_to_photo(place / "out"), photo, exchange.subject_centre(asked.photos)
        )
        exchange.copied_obj(exchange.last_file(place / "out", "*_full.obj"), asked.out, move)


if __name__ == "__main__":
    main()
