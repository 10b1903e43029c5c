"""``normals.npz``: the normal maps of a cell on disk, eight bits a component.

For a view such as 00 the file has ``camera_00`` (JSON text), ``mask_00`` (H, W) bool and the maps
``front_00``, ``back_00``, ``body_front_00``, ``body_back_00`` (H, W, 3) int8, 127 times the normal.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from harness.core.artifacts import NormalMaps
from harness.core.cameras.camera import Camera
from harness.core.errors import DataError, MethodError
from harness.core.files.atomic import atomic_path
from harness.geometry.images import packed_normals, unit_normals

__all__ = ["load_normals", "save_normals"]

_MAPS = ("front", "back", "body_front", "body_back")


def save_normals(path: Path, views: Sequence[NormalMaps]) -> None:
    """Write the maps atomically; directions are kept to half a degree, which pictures need."""
    arrays: dict[str, NDArray[np.generic]] = {}
    for maps in views:
        mark = f"{maps.view:02d}"
        arrays[f"camera_{mark}"] = np.array(json.dumps(maps.camera.to_dict()))
        arrays[f"mask_{mark}"] = maps.mask
        for name in _MAPS:
            arrays[f"{name}_{mark}"] = packed_normals(getattr(maps, name))
    with atomic_path(path) as temporary:
        np.savez_compressed(temporary, **arrays)  # type: ignore[arg-type]


def load_normals(path: Path) -> tuple[NormalMaps, ...]:
    """The maps in a file, by view, of unit length again.

    Raises:
        DataError: no such file, or not one that ``save_normals`` wrote.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            marks = sorted(name[len("mask_") :] for name in file.files if name.startswith("mask_"))
            return tuple(
                NormalMaps(
                    int(mark),
                    Camera.from_dict(json.loads(str(file[f"camera_{mark}"]))),
                    file[f"mask_{mark}"],
                    *(unit_normals(file[f"{name}_{mark}"].astype(float)) for name in _MAPS),
                )
                for mark in marks
            )
    except FileNotFoundError as error:
        raise DataError(f"no normal maps at {path}", hint="Evaluate the method again") from error
    except (KeyError, ValueError, OSError, BadZipFile, MethodError) as error:
        raise DataError(
            f"{path} holds no normal maps", got=repr(error), hint="Evaluate the method again"
        ) from error
