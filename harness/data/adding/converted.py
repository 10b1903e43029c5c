"""A scan becomes the files that the harness reads: upright, one OBJ, one material, one picture."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_directory, read_json, write_json
from harness.core.files.hashing import file_sha256
from harness.core.formats.obj import write_obj
from harness.core.mesh import Mesh
from harness.data.adding.named_files import named_files
from harness.data.adding.painted import read_painted
from harness.data.scans import ADDED
from harness.data.stature import stature
from harness.geometry.images import save_png
from harness.geometry.occlusion import hidden_faces

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
_MATERIAL, _PICTURE = "material0", "material0.png"
#: Grows when the same scan would become other files.
_VERSION = 2


@dataclass(frozen=True, slots=True)
class Conversion:
    """How scans are converted.

    Attributes:
        up: The axis of the file that points up, a key of ``UPS``.
        height_m: The height that each scan gets, metres; 0 where ``factor`` tells.
        factor: What coordinates are multiplied by.
        grey: Whether scans without colours are made grey.
        outer: Whether what no outside ray reaches is left out.
        folder: What the user named: a scan may name any file in it.
    """

    up: str
    height_m: float = 0.0
    factor: float = 1.0
    grey: bool = False
    outer: bool = False
    folder: Path | None = None

    @property
    def folders(self) -> tuple[Path, ...]:
        """Where files that a scan names may lie, besides its own folder."""
        return (self.folder,) if self.folder else ()

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            "up": self.up,
            "height_m": self.height_m,
            "factor": self.factor,
            "grey": self.grey,
            "outer": self.outer,
            "version": _VERSION,
        }


def is_converted(source: Path, conversion: Conversion, directory: Path) -> bool:
    """Whether a folder holds a scan as ``convert_scan`` would write it now.

    Raises:
        DataError: the folder holds something else, or the scan names a file that is not there.
    """
    mark = directory / ADDED
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
        and found.get("sha256") == _hashes(source, conversion)
    )


def convert_scan(source: Path, conversion: Conversion, directory: Path) -> None:
    """Write ``<id>.obj``, ``material0.mtl`` and ``material0.png`` into a folder named by the id.

    The folder appears when all of it is there.

    Raises:
        DataError: a scan that cannot be read, or without colours; a full disk.
    """
    hashes = _hashes(source, conversion)
    painted = read_painted(source, *conversion.folders, grey=conversion.grey)
    mesh = _placed(painted.mesh, conversion)
    with atomic_directory(directory) as folder:
        write_obj(folder / f"{directory.name}.obj", mesh, material=_MATERIAL)
        material = f"newmtl {_MATERIAL}\nKd 1 1 1\nmap_Kd {_PICTURE}\n"
        (folder / f"{_MATERIAL}.mtl").write_text(material, encoding="ascii")
        save_png(folder / _PICTURE, painted.pixels)
        marks = {"conversion": conversion.to_dict(), "sha256": hashes, "colours": painted.colours,
                 "told": painted.told}  # fmt: skip
        write_json(folder / ADDED, marks)


def told_of(directory: Path) -> tuple[str, ...]:
    """What was out of the ordinary when a scan was converted."""
    return tuple(read_json(directory / ADDED)["told"])


def _hashes(source: Path, conversion: Conversion) -> dict[str, str]:
    """The scan's file, and the materials and pictures that it names."""
    named = named_files(source, *conversion.folders)
    return {os.path.relpath(path, source.parent): file_sha256(path) for path in (source, *named)}


def _placed(mesh: Mesh, conversion: Conversion) -> Mesh:
    if conversion.outer:
        mesh = mesh.submesh(~hidden_faces(mesh))
    upright = replace(mesh, vertices=mesh.vertices @ UPS[conversion.up].T)
    factor = conversion.factor
    if conversion.height_m:
        factor = conversion.height_m / float(stature(upright).extent[1])
    return replace(upright, vertices=upright.vertices * factor)
