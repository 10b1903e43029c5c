"""A cell's body and normal maps on disk, beside its mesh.

``body.npz`` has ``model`` (text), ``vertices`` (V, 3) and ``joints`` (J, 3) in metres, world frame,
``faces`` (F, 3), and each of the model's own parameters as ``parameter_NAME``.

``normals.npz`` has for a view such as 00 ``camera_00`` (JSON text), ``mask_00`` (H, W) bool and the
maps ``front_00``, ``back_00``, ``body_front_00``, ``body_back_00`` (H, W, 3) int8, which are 127
times the normal.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.array_files.npz import read_array_npz, read_required_arrays, write_npz
from harness.core.artifacts import Body, NormalMaps
from harness.core.cameras.camera import Camera
from harness.core.errors import DataError, MethodError
from harness.core.mesh import Mesh
from harness.geometry.images import packed_normals, unit_normals

MESH_FILE = "mesh.ply"
BODY_FILE = "body.npz"
NORMALS_FILE = "normals.npz"
_MAPS = ("front", "back", "body_front", "body_back")
_EVALUATE = "Evaluate the method again"


def save_body(path: Path, body: Body) -> None:
    """Write a fitted body atomically."""
    write_npz(path, body.to_arrays())


def load_body_mesh(path: Path, source: str) -> Mesh:
    """The surface of a stored body, world metres, named as coming from ``source``.

    Raises:
        DataError: no such file, or not one that ``save_body`` wrote.
    """
    arrays = read_required_arrays(path, ("vertices", "faces"), "fitted body", _EVALUATE)
    return Mesh(arrays["vertices"], arrays["faces"], source=source)


def save_normals(path: Path, views: Sequence[NormalMaps]) -> None:
    """Write normal maps atomically; directions are kept to half a degree, enough for pictures."""
    arrays: dict[str, NDArray[Any]] = {}
    for maps in views:
        mark = f"{maps.view:02d}"
        arrays[f"camera_{mark}"] = np.array(json.dumps(maps.camera.to_dict()))
        arrays[f"mask_{mark}"] = maps.mask
        for name in _MAPS:
            arrays[f"{name}_{mark}"] = packed_normals(getattr(maps, name))
    write_npz(path, arrays)


def load_normals(path: Path) -> tuple[NormalMaps, ...]:
    """The maps in a file, by view, of unit length again.

    Raises:
        DataError: no such file, or not one that ``save_normals`` wrote.
    """
    try:
        arrays = read_array_npz(path)
        marks = sorted(name[len("mask_") :] for name in arrays if name.startswith("mask_"))
        return tuple(_view(arrays, mark) for mark in marks)
    except (DataError, KeyError, ValueError, MethodError) as error:
        raise DataError(
            f"{path} holds no normal maps",
            expected=f"a file {NORMALS_FILE} as an evaluation writes it",
            got=str(error),
            hint=_EVALUATE,
        ) from error


def _view(arrays: Mapping[str, NDArray[Any]], mark: str) -> NormalMaps:
    camera = Camera.from_dict(json.loads(str(arrays[f"camera_{mark}"])))
    maps = [unit_normals(arrays[f"{name}_{mark}"].astype(float)) for name in _MAPS]
    return NormalMaps(int(mark), camera, arrays[f"mask_{mark}"], *maps)
