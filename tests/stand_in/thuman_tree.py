"""Scans and fits written in THuman's exact layout, so that its whole path can be tried without it.

Nothing in here is THuman's: the surfaces are whatever mesh is handed in.
"""

from __future__ import annotations

import io
import pickle
import pickletools
from pathlib import Path

import numpy as np
from PIL import Image

from harness.core.mesh import Mesh
from harness.files.obj import write_obj

#: The folders that the two archives of version 2.1 unpack to, side by side.
SCANS, FITS = "THuman2.1_Release_", "THuman2.1_Release Smpl-X Paras_new"
_MATERIAL = """\
newmtl material0
Ka 1.00000000 1.00000000 1.00000000
Kd 1.00000000 1.00000000 1.00000000
Ks 0.40000000 0.40000000 0.40000000
Ns 0.00000000
map_Kd material0.jpeg
"""
_SIZES = {
    "betas": 10, "global_orient": 3, "body_pose": 63, "left_hand_pose": 12, "right_hand_pose": 12,
    "jaw_pose": 3, "leye_pose": 3, "reye_pose": 3, "expression": 10,
}  # fmt: skip


class _Tracked(np.ndarray):
    """Stands for trimesh's ``TrackedArray``, which is what real files name."""

    def __reduce__(self):
        made, arguments, state = super().__reduce__()
        return made, arguments, state


def fit_bytes(scale: float, translation: np.ndarray, **values: np.ndarray) -> bytes:
    """The pickle of a fit as the real ones are: protocol 3, ``scale`` a 0-d ``TrackedArray``."""
    fit = {name: np.zeros((1, size), np.float32) for name, size in _SIZES.items()}
    fit |= {name: np.asarray(value, np.float32).reshape(1, -1) for name, value in values.items()}
    for name, size in _SIZES.items():
        assert fit[name].shape == (1, size), name
    fit["scale"] = np.asarray(scale).view(_Tracked)
    fit["translation"] = np.asarray(translation, np.float32)
    out = io.BytesIO()
    pickle.Pickler(out, protocol=3).dump(fit)
    own = f"c{_Tracked.__module__}\n{_Tracked.__qualname__}\n"
    theirs = "ctrimesh.caching\nTrackedArray\n"
    made = out.getvalue().replace(own.encode(), theirs.encode())
    assert b"TrackedArray" in made
    pickletools.genops(made)
    return made


def write_subject(
    folder: Path, subject: str, mesh: Mesh, texture: Path | None, fit: bytes, fits: str = FITS
) -> None:
    """One subject's scan below ``SCANS`` and its fit below ``fits``, in a folder."""
    scan = folder / SCANS / "model" / subject
    scan.mkdir(parents=True)
    write_obj(scan / f"{subject}.obj", mesh)
    (scan / "material0.mtl").write_text(_MATERIAL)
    if texture is None:
        Image.new("RGB", (8, 8), (200, 100, 50)).save(scan / "material0.jpeg")
    else:
        (scan / "material0.jpeg").write_bytes(texture.read_bytes())
    (folder / fits / "smplx" / subject).mkdir(parents=True, exist_ok=True)
    (folder / fits / "smplx" / subject / "smplx_param.pkl").write_bytes(fit)
