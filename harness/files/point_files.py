"""PLY files without faces: clouds of points, and Gaussians as 3DGS and 2DGS write them."""

from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError, MethodError
from harness.core.results import Gaussians, PointCloud
from harness.files.mesh_files import MOST_MESH_BYTES
from harness.files.ply import read_vertices

#: A Gaussian's properties: logit of opacity, logarithms of standard deviations, quaternion w x y z.
_OPACITY, _SCALES = "opacity", ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_NORMALS = ("nx", "ny", "nz")


def load_points(path: Path) -> PointCloud | Gaussians | None:
    """The cloud or the Gaussians in a PLY file; None for a file that is none, or has faces.

    Two scales, as 2DGS writes them, are a flat Gaussian.

    Raises:
        DataError: a file that cannot be read, or Gaussians with properties missing.
    """
    if path.suffix.lower() != ".ply" or not path.is_file():
        return None
    if path.stat().st_size > MOST_MESH_BYTES:
        return None
    columns = read_vertices(path)
    if columns is None:
        return None
    try:
        if _OPACITY in columns and _SCALES[0] in columns:
            return _gaussians(path, columns)
        normals = _stacked(columns, _NORMALS) if all(n in columns for n in _NORMALS) else None
        if normals is not None and not normals.any():
            normals = None
        return PointCloud(_stacked(columns, tuple("xyz")), normals)
    except (KeyError, MethodError) as error:
        raise DataError(f"{path} holds no usable points", got=str(error)) from error


def _gaussians(path: Path, columns: dict[str, Floats]) -> Gaussians:
    missing = [name for name in (*_SCALES[:2], *_ROTATION) if name not in columns]
    if missing:
        raise DataError(f"{path} holds Gaussians without {', '.join(missing)}")
    scales = [np.exp(columns[name]) for name in _SCALES if name in columns]
    if len(scales) < len(_SCALES):
        scales.append(np.zeros_like(scales[0]))
    opacity = 1 / (1 + np.exp(-np.clip(columns[_OPACITY], -50, 50)))
    rotations = _stacked(columns, _ROTATION)
    return Gaussians(_stacked(columns, tuple("xyz")), np.stack(scales, axis=1), rotations, opacity)


def _stacked(columns: dict[str, Floats], names: tuple[str, ...]) -> Floats:
    return np.stack([columns[name] for name in names], axis=1)
