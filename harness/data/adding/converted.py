"""A scan becomes the files that the harness reads: upright, one OBJ, one material, one picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_directory, read_json, write_json
from harness.core.files.hashing import file_sha256
from harness.core.formats.obj import write_obj
from harness.core.mesh import Mesh
from harness.data.adding.named_files import material_files, picture_files
from harness.data.adding.painted import Painted, read_painted
from harness.geometry.images import save_png

#: Rows of the rotation that turns an axis of the file up, by quarter turns about X where they
#: do. +z is how Blender has it, whose -Y becomes +Z.
UPS: dict[str, Floats] = {
    "+y": np.eye(3),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "+z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "-z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "+x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "-x": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}
_MATERIAL, _PICTURE, _MARK = "material0", "material0.png", "added.json"
#: Grows when the same scan would become other files.
_VERSION = 1


@dataclass(frozen=True, slots=True)
class Conversion:
    """How scans are converted.

    Attributes:
        up: The axis of the file that points up, a key of ``UPS``.
        height_m: The height that each scan gets, metres; 0 where ``factor`` tells.
        factor: What coordinates are multiplied by.
        grey: Whether scans without colours are made grey.
    """

    up: str
    height_m: float = 0.0
    factor: float = 1.0
    grey: bool = False

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            "up": self.up,
            "height_m": self.height_m,
            "factor": self.factor,
            "grey": self.grey,
            "version": _VERSION,
        }


def is_converted(source: Path, conversion: Conversion, directory: Path) -> bool:
    """Whether a folder holds a scan as ``convert_scan`` would write it now.

    Raises:
        DataError: the folder holds something else, or the scan names a file that is not there.
    """
    mark = directory / _MARK
    if not directory.exists():
        return False
    if not mark.is_file():
        raise DataError(
            f"{directory} is there and was not made by 'harness data add'",
            hint="Move it away, or choose another name for the dataset",
        )
    found = read_json(mark)
    whole = (directory / f"{directory.name}.obj", directory / _PICTURE)
    return (
        all(path.is_file() for path in whole)
        and found.get("conversion") == conversion.to_dict()
        and found.get("sha256") == _hashes(source)
    )


def convert_scan(source: Path, conversion: Conversion, directory: Path) -> str:
    """Write ``<id>.obj``, ``material0.mtl`` and ``material0.png`` into a folder named by the id.

    The folder appears when all of it is there. Returns where the colours came from, in words.

    Raises:
        DataError: a scan that cannot be read, or without colours; a full disk.
    """
    hashes = _hashes(source)
    painted = read_painted(source, grey=conversion.grey)
    mesh = _placed(painted, conversion)
    with atomic_directory(directory) as folder:
        write_obj(folder / f"{directory.name}.obj", mesh, material=_MATERIAL)
        material = f"newmtl {_MATERIAL}\nKd 1 1 1\nmap_Kd {_PICTURE}\n"
        (folder / f"{_MATERIAL}.mtl").write_text(material, encoding="ascii")
        save_png(folder / _PICTURE, painted.pixels)
        marks = {"conversion": conversion.to_dict(), "sha256": hashes, "colours": painted.colours}
        write_json(folder / _MARK, marks)
    return painted.colours


def _hashes(source: Path) -> dict[str, str]:
    """The scan's file, and the materials and pictures that it names."""
    named = [*material_files(source), *(path for path in picture_files(source) if path.is_file())]
    return {path.name: file_sha256(path) for path in (source, *named)}


def _placed(painted: Painted, conversion: Conversion) -> Mesh:
    mesh = painted.mesh
    upright = replace(mesh, vertices=mesh.vertices @ UPS[conversion.up].T)
    factor = conversion.factor
    if conversion.height_m:
        factor = conversion.height_m / float(upright.extent[1])
    return replace(upright, vertices=upright.vertices * factor)
