"""Scans as 4D-DRESS and X-Humans store them: pickled arrays, and the texture in a file beside."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.core.arrays import Bytes
from harness.core.errors import DataError
from harness.core.files.pickles import read_array_pickle
from harness.core.mesh import Mesh

_WANTED = ("vertices", "faces", "uvs", "colors")


def atlas_of(path: Path) -> Path:
    """Where the texture of ``mesh-fNNNNN.pkl`` lies."""
    return path.with_name(path.name.replace("mesh-", "atlas-", 1))


def read_pickled_mesh(path: Path) -> tuple[Mesh, Bytes | None, Bytes | None]:
    """A pickled scan, its texture and the colours of its vertices.

    Returns:
        The mesh in the file's units; (H, W, 3) uint8 sRGB, the top row first, where there is a
        texture; (V, 3) uint8 sRGB where there are colours.

    Raises:
        DataError: a damaged file, or one that holds more than arrays where the scan should be.
    """
    arrays = read_array_pickle(path, _WANTED)
    if missing := [name for name in _WANTED[:2] if name not in arrays]:
        raise DataError(f"{path} holds no scan", expected="vertices and faces",
                        got=f"no {' and no '.join(missing)}")  # fmt: skip
    vertices, faces, uv = arrays["vertices"], arrays["faces"], arrays.get("uvs")
    if uv is not None and uv.shape != (len(vertices), 2):
        raise DataError(f"{path} has texture coordinates of another number than vertices",
                        expected=f"({len(vertices)}, 2)", got=str(uv.shape))  # fmt: skip
    mesh = Mesh(vertices, faces, uv, None if uv is None else faces, source=str(path))
    atlas = atlas_of(path)
    pixels = None
    if uv is not None and atlas.is_file():
        found = read_array_pickle(atlas).get("")
        if found is None or found.ndim != 3 or found.shape[2] < 3 or found.dtype != np.uint8:
            raise DataError(f"{atlas} holds no picture", expected="one array (H, W, 3) of bytes")
        # Its first row belongs to v = 0.
        pixels = np.ascontiguousarray(found[::-1, :, :3])
    colours = arrays.get("colors")
    if colours is None:
        return mesh, pixels, None
    if colours.ndim != 2 or len(colours) != len(vertices) or colours.shape[1] < 3:
        raise DataError(f"{path} has colours of another number than vertices")
    scale = 255.0 if colours.dtype.kind == "f" and colours.max(initial=0.0) <= 1.0 else 1.0
    return mesh, pixels, np.clip(np.round(colours[:, :3] * scale), 0, 255).astype(np.uint8)
