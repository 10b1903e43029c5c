"""PSHuman as its authors wrote it, on the frontal photo; its mesh stays in a cube of its own.

run.py --photos FOLDER --out mesh.obj --checkout PSHuman --weights DIR --crop 740 --seed 600
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import exchange


def main() -> None:
    """Run the program, hand its mesh on."""
    asked = exchange.arguments("checkout", "weights", "crop", "seed")
    (photo,) = exchange.read_photos(asked.photos)
    with tempfile.TemporaryDirectory(dir=str(asked.out.parent)) as name:
        place = Path(name)
        (place / "in").mkdir()
        shutil.copyfile(photo.path, place / "in" / "photo.png")
        words = [sys.executable, "inference.py", "--config", "configs/inference-768-6view.yaml"]
        words += [
            f"pretrained_model_name_or_path={asked.weights}",
            f"validation_dataset.crop_size={asked.crop}",
            "with_smpl=false",
            f"validation_dataset.root_dir={place / 'in'}",
            f"seed={asked.seed}",
            "num_views=7",
            "save_mode=rgb",
            f"save_dir={place / 'views'}",
            f"recon_opt.res_path={place / 'out'}",
        ]
        exchange.run(words, Path(asked.checkout))
        exchange.copied_obj(
            exchange.last_file(place / "out", "result_clr_scale*_photo.obj"), asked.out
        )


if __name__ == "__main__":
    main()
