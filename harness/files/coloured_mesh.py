"""A mesh with a colour at each vertex, and its files: binary PLY and binary glTF (GLB).

Both files keep positions, faces and colours; ``load_mesh`` reads the surface of either.
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Bytes, Floats, Ints, Mask
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path
from harness.core.mesh import Mesh

_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_FLOAT, _SHORT, _INT = 5126, 5123, 5125
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


@dataclass(frozen=True, slots=True, eq=False)
class FileColours:
    """A file's surface and all that it says of its colours.

    Attributes:
        mesh: The surface, with texture coordinates where the file has them.
        part: (F,) which of the file's materials or pictures, by number, each face has.
        names: What the file calls materials, by number; none where it numbers pictures.
        vertices: (V, 3) uint8 sRGB, or None.
        faces: (F, 3) uint8 sRGB, or None.
    """

    mesh: Mesh
    part: Ints
    names: tuple[str, ...] = ()
    vertices: Bytes | None = None
    faces: Bytes | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ColouredMesh:
    """A mesh and the colours of its vertices.

    Attributes:
        mesh: The surface.
        colours: (V, 3) uint8 sRGB.
        seen: (V,) whether a photo shows the vertex; the colour of the others was filled in.

    Raises:
        DataError: colours that are not one for each vertex.
    """

    mesh: Mesh
    colours: Bytes
    seen: Mask

    def __post_init__(self) -> None:
        count = len(self.mesh.vertices)
        if self.colours.shape != (count, 3) or self.seen.shape != (count,):
            raise DataError(
                f"{self.mesh.source} has not one colour for each vertex",
                expected=f"colours ({count}, 3) and seen ({count},)",
                got=f"{self.colours.shape} and {self.seen.shape}",
            )

    @property
    def seen_share(self) -> float:
        """Share of the vertices that a photo shows, 0 to 1."""
        return float(self.seen.mean())


def save_coloured(path: Path, coloured: ColouredMesh) -> None:
    """Write a coloured mesh atomically as PLY or GLB, by the path's extension.

    Raises:
        DataError: another extension.
    """
    writers = {".ply": write_coloured_ply, ".glb": write_coloured_glb}
    suffix = path.suffix.lower()
    if suffix not in writers:
        raise DataError(f"cannot write {path}", expected=" or ".join(writers), got=suffix)
    writers[suffix](path, coloured)


def write_coloured_ply(path: Path, coloured: ColouredMesh) -> None:
    """Write positions (float32), sRGB colours (uchar) and faces, atomically."""
    mesh = coloured.mesh
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(mesh.vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(mesh.vertices), dtype=[("place", "<f4", (3,)), ("colour", "u1", (3,))])
    rows["place"], rows["colour"] = mesh.vertices, coloured.colours
    faces = np.empty(len(mesh.faces), dtype=[("n", "u1"), ("corners", "<i4", (3,))])
    faces["n"], faces["corners"] = 3, mesh.faces
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(header.encode("ascii"))
        stream.write(rows.tobytes())
        stream.write(faces.tobytes())


def write_coloured_glb(path: Path, coloured: ColouredMesh) -> None:
    """Write one unlit mesh with its vertex colours as glTF 2.0 binary, atomically.

    glTF holds vertex colours in linear light, so sRGB is converted, in 16 bits a channel. The
    material is unlit where a viewer knows ``KHR_materials_unlit``, because photos hold their light
    already; other viewers light it by its normals.
    """
    mesh = coloured.mesh
    buffers = [
        (mesh.vertices.astype("<f4"), _FLOAT, "VEC3", _ARRAY_BUFFER),
        (_normals(coloured).astype("<f4"), _FLOAT, "VEC3", _ARRAY_BUFFER),
        (_linear_colours(coloured), _SHORT, "VEC4", _ARRAY_BUFFER),
        (mesh.faces.astype("<u4").ravel(), _INT, "SCALAR", _ELEMENT_BUFFER),
    ]
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    start = 0
    for array, kind, width, target in buffers:
        size = array.nbytes
        views.append({"buffer": 0, "byteOffset": start, "byteLength": size, "target": target})
        accessors.append(
            {
                "bufferView": len(accessors),
                "componentType": kind,
                "count": len(array),
                "type": width,
                **({"normalized": True} if kind == _SHORT else {}),
            }
        )
        start += size
    # The format asks for the bounds of positions.
    accessors[0] |= {"min": buffers[0][0].min(axis=0).tolist()}
    accessors[0] |= {"max": buffers[0][0].max(axis=0).tolist()}
    document = {**_SCENE, "buffers": [{"byteLength": start}]}
    document |= {"bufferViews": views, "accessors": accessors}
    _write_chunks(path, document, [array for array, *_ in buffers], start)


_SCENE: dict[str, Any] = {
    "asset": {"version": "2.0", "generator": "mexecon-harness"},
    "extensionsUsed": ["KHR_materials_unlit"],
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "materials": [
        {
            "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
            "extensions": {"KHR_materials_unlit": {}},
        }
    ],
    "meshes": [
        {
            "primitives": [
                {
                    "attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2},
                    "indices": 3,
                    "material": 0,
                }
            ]
        }
    ],
}


def _write_chunks(
    path: Path, document: dict[str, Any], arrays: list[NDArray[Any]], size: int
) -> None:
    """All arrays have whole words of four bytes, so that only the text needs padding."""
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text += b" " * (-len(text) % 4)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(b"glTF" + struct.pack("<II", 2, 12 + 8 + len(text) + 8 + size))
        stream.write(struct.pack("<II", len(text), _JSON_CHUNK) + text)
        stream.write(struct.pack("<II", size, _BINARY_CHUNK))
        for array in arrays:
            stream.write(array.tobytes())


def _linear_colours(coloured: ColouredMesh) -> NDArray[np.uint16]:
    """(V, 4) linear light in 16 bits, opaque (IEC 61966-2-1)."""
    level = np.arange(256) / 255.0
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    colours = np.full((len(coloured.colours), 4), 65535, dtype="<u2")
    colours[:, :3] = np.round(65535.0 * linear).astype("<u2")[coloured.colours]
    return colours


def _normals(coloured: ColouredMesh) -> Floats:
    """(V, 3) unit normals; straight up where faces cancel, because the format wants unit length."""
    mesh = coloured.mesh
    vectors = mesh.face_normals()
    sums = np.stack(
        [
            sum(np.bincount(mesh.faces[:, corner], axis, len(mesh.vertices)) for corner in range(3))
            for axis in vectors.T
        ],
        axis=1,
    )
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(length > 0, sums / np.where(length > 0, length, 1.0), (0.0, 1.0, 0.0))
