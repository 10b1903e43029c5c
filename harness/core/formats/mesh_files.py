"""Mesh files by extension: each defect is one clear error, and nothing is repaired."""

from __future__ import annotations

from pathlib import Path

from harness.core.errors import DataError
from harness.core.formats.gltf import read_glb
from harness.core.formats.obj import read_obj, write_obj
from harness.core.formats.plain import read_off, read_stl
from harness.core.formats.ply import read_ply, write_ply
from harness.core.mesh import Mesh

_READERS = {".ply": read_ply, ".glb": read_glb, ".off": read_off, ".stl": read_stl}
#: File name extensions that ``load_mesh`` reads, in the order in which a folder is searched.
MESH_SUFFIXES = (".ply", ".obj", ".glb", ".off", ".stl")
#: Larger files are refused. A scan of a person takes up to some 100 MiB.
MOST_MESH_BYTES = 512 * 2**20


def load_mesh(path: str | Path, *, texture: bool = False, seams: bool = False) -> Mesh:
    """The mesh in a file, unchanged: nothing is merged, dropped, scaled or turned.

    Args:
        path: An OBJ, PLY, GLB, OFF or STL file.
        texture: Whether texture coordinates and image are wanted (OBJ only).
        seams: Whether texture coordinates are wanted where the file has them, without an image:
            they show where the texture's seams are. They are read only from OBJ files.

    Raises:
        DataError: no such file, an unknown format, more than ``MOST_MESH_BYTES``, or any defect of
            content.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise DataError(
            f"{path} is of an unknown mesh format",
            expected=", ".join(MESH_SUFFIXES),
            got=suffix or "no extension",
        )
    if not path.is_file():
        raise DataError(f"no mesh at {path}")
    if path.stat().st_size > MOST_MESH_BYTES:
        raise DataError(
            f"{path} is larger than any scan of a person",
            expected=f"at most {MOST_MESH_BYTES} bytes",
            got=str(path.stat().st_size),
            hint="Decimate it, or export it as binary PLY",
        )
    if texture and suffix != ".obj":
        raise DataError(f"{path} cannot be read with its texture", expected="an OBJ file")
    try:
        if suffix == ".obj":
            return read_obj(path, texture=texture, seams=seams)
        return _READERS[suffix](path)
    except DataError as error:
        if not error.hint:
            error.hint = "Export it again from the program that made it"
        raise
    except OSError as error:
        raise DataError(f"could not read {path}: {error.strerror or error}") from error


def save_mesh(path: str | Path, mesh: Mesh) -> None:
    """Write a mesh atomically as PLY (binary) or OBJ, by the path's extension."""
    writers = {".ply": write_ply, ".obj": write_obj}
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in writers:
        raise DataError(f"cannot write {path}", expected=" or ".join(writers), got=suffix)
    writers[suffix](path, mesh)
