"""Mesh files by extension: each defect is one clear error, and nothing is repaired."""

import codecs
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Bytes
from harness.core.errors import DataError
from harness.core.files.pickles import read_array_pickle
from harness.core.mesh import Mesh
from harness.files.gltf import read_glb
from harness.files.obj import read_obj, write_obj
from harness.files.ply import read_ply, write_ply
from harness.files.polygons import cut_polygons

_STL_HEADER_BYTES, _MOST_SHOWN = 84, 60
_STL_FACET = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_off(path: Path) -> Mesh:
    """The mesh of an ASCII OFF file; polygons become triangles.

    Raises:
        DataError: not an OFF file, or fewer numbers than its header promises.
    """
    content = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    text = re.sub(r"#[^\r\n]*", "", content.decode("ascii", errors="replace")).lstrip()
    header = re.match(r"C?OFF\b", text)
    if header is None:
        raise DataError(f"{path} is not an OFF file", expected="it to start with 'OFF'")
    rows = [line.split() for line in text[header.end() :].splitlines() if line.strip()]
    try:
        vertex_count, face_count = int(rows[0][0]), int(rows[0][1])
        vertex_rows = rows[1 : 1 + vertex_count]
        polygons = rows[1 + vertex_count : 1 + vertex_count + face_count]
        if min(vertex_count, face_count) < 0 or len(rows) != 1 + vertex_count + face_count:
            raise ValueError(
                f"{len(vertex_rows)} of {vertex_count} vertices, "
                f"{len(rows) - 1 - len(vertex_rows)} of {face_count} faces"
            )
        vertices = np.array([row[:3] for row in vertex_rows], dtype=np.float64)
        counts = np.array([int(row[0]) for row in polygons], dtype=np.int64)
        short = [row for row in polygons if not 3 <= int(row[0]) < len(row)]
        if short:
            raise ValueError(f"a face row '{' '.join(short[0])[:_MOST_SHOWN]}'")
        words = [word for row in polygons for word in row[1 : 1 + int(row[0])]]
        corners = np.array([int(word) for word in words], dtype=np.int64)
        indices = corners[cut_polygons(vertices, corners, counts)]
    except DataError as error:
        raise error.located(path) from error
    except (ArithmeticError, ValueError, IndexError) as error:
        raise DataError(f"{path} is truncated or broken", got=str(error)) from error
    return Mesh(vertices=vertices, faces=indices, source=str(path))


def read_stl(path: Path) -> Mesh:
    """The mesh of an STL file, binary or ASCII, with equal corners merged into one vertex.

    Raises:
        DataError: neither form, or shorter than its header promises.
    """
    content = path.read_bytes()
    corners = _binary_stl(content)
    if corners is None:
        corners = _ascii_stl(content, path)
    vertices, inverse = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return Mesh(vertices=vertices, faces=inverse.reshape(-1, 3), source=str(path))


def _binary_stl(content: bytes) -> NDArray[np.float64] | None:
    if len(content) < _STL_HEADER_BYTES:
        return None
    count = int(np.frombuffer(content, "<u4", 1, 80)[0])
    # ASCII files also start with 80 bytes of something: only the exact length proves binary.
    if len(content) != _STL_HEADER_BYTES + count * _STL_FACET.itemsize:
        return None
    facets = np.frombuffer(content, _STL_FACET, count, _STL_HEADER_BYTES)
    return facets["corners"].astype(np.float64)


def _ascii_stl(content: bytes, path: Path) -> NDArray[np.float64]:
    text = content.removeprefix(codecs.BOM_UTF8).lower()
    words = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", text)
    complete = re.match(rb"\s*solid\b.*\bendsolid\b", text, re.DOTALL)
    if not complete or len(words) != 3 * len(re.findall(rb"\bendfacet\b", text)):
        raise DataError(
            f"{path} is not a complete STL file",
            expected="ASCII 'solid ... endsolid', or binary of the length in its header",
            got=f"{len(content)} bytes",
        )
    try:
        return np.array(words, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError as error:
        raise DataError(f"{path} has a vertex that is not numbers", got=str(error)) from error


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
