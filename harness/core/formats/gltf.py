"""Binary glTF (GLB): the triangles of all nodes, in the file's own axes (+Y up, metres)."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints
from harness.core.cameras.frames import rotation_from_quaternion
from harness.core.errors import DataError
from harness.core.mesh import Mesh

_KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_POINTS_AND_LINES, _TRIANGLES = range(4), 4
#: Nodes may repeat one mesh many times, so a small file could expand to any number of vertices.
_MOST_ELEMENTS, _MOST_JSON_BYTES = 10_000_000, 16 * 2**20
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


@dataclass(frozen=True, slots=True)
class _Glb:
    document: dict[str, Any]
    binary: bytes
    visited: set[int] = field(default_factory=set[int])


def read_glb(path: Path) -> Mesh:
    """The geometry of a GLB file, all nodes of its scene joined, at rest; textures are not read.

    Raises:
        DataError: not a GLB, truncated, compressed (Draco, meshopt), with triangle strips or with
            sparse accessors.
    """
    content = path.read_bytes()
    if content[:4] != b"glTF" or len(content) < 20:
        raise DataError(f"{path} is not a GLB file", expected="it to start with 'glTF'")
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2 or length > len(content):
        raise DataError(
            f"{path} is truncated or of another version",
            expected=f"glTF 2, {length} bytes",
            got=f"glTF {version}, {len(content)} bytes",
        )
    try:
        glb = _chunks(content[:length])
        compressed = [
            name for name in glb.document.get("extensionsRequired", []) if "KHR_texture" not in name
        ]
        if compressed:
            raise DataError(
                f"needs {', '.join(compressed)}", hint="Export it again without compression"
            )
        pieces = _pieces(glb)
    except DataError as error:
        raise error.located(path) from error
    except RecursionError as error:
        raise DataError(f"{path} has nodes nested too deep") from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise DataError(
            f"{path} is not a readable GLB", got=f"{type(error).__name__}: {error}"
        ) from error
    if not pieces:
        raise DataError(f"{path} has no triangles", expected="a mesh in its scene")
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in pieces[:-1]])
    return Mesh(
        vertices=np.concatenate([vertices for vertices, _ in pieces]),
        faces=np.concatenate(
            [faces + start for (_, faces), start in zip(pieces, offsets, strict=True)]
        ),
        source=str(path),
    )


def _pieces(glb: _Glb) -> list[tuple[Floats, Ints]]:
    pieces: list[tuple[Floats, Ints]] = []
    count = 0
    for node in _roots(glb):
        for piece in _node(glb, node, np.eye(4)):
            pieces.append(piece)
            count += len(piece[0]) + len(piece[1])
            if count > _MOST_ELEMENTS:
                raise ValueError(f"more than {_MOST_ELEMENTS} vertices and triangles")
    return pieces


def _chunks(content: bytes) -> _Glb:
    document: dict[str, Any] = {}
    binary = b""
    position = 12
    while position + 8 <= len(content):
        size, kind = struct.unpack_from("<II", content, position)
        chunk = content[position + 8 : position + 8 + size]
        if kind == _JSON_CHUNK:
            if size > _MOST_JSON_BYTES:
                raise ValueError(f"a description of {size} bytes")
            document = json.loads(chunk)
        elif kind == _BINARY_CHUNK:
            binary = chunk
        position += 8 + size
    return _Glb(document, binary)


def _roots(glb: _Glb) -> list[int]:
    """The top nodes of the default scene, or of the whole file if it has no scene."""
    if scenes := glb.document.get("scenes"):
        return scenes[glb.document.get("scene", 0)].get("nodes", [])
    nodes = glb.document.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    return [index for index in range(len(nodes)) if index not in children]


def _node(glb: _Glb, index: int, parent: Floats) -> Iterator[tuple[Floats, Ints]]:
    """Vertices and faces of every primitive at and below a node, in the file's axes."""
    if index in glb.visited:
        # The format gives a node one parent; shared nodes could grow without end.
        raise ValueError(f"node {index} is shared, or a node that is its own ancestor")
    glb.visited.add(index)
    node = glb.document["nodes"][index]
    transform = parent @ _node_transform(node)
    mesh: dict[str, Any] = glb.document["meshes"][node["mesh"]] if "mesh" in node else {}
    for primitive in mesh.get("primitives", []):
        mode = primitive.get("mode", _TRIANGLES)
        if mode in _POINTS_AND_LINES:
            continue
        if mode != _TRIANGLES:
            raise ValueError("triangle strips and fans are not supported")
        vertices, faces = _primitive(glb, primitive)
        # A mirrored node turns its triangles inside out.
        mirrored = np.linalg.det(transform[:3, :3]) < 0
        yield (
            vertices @ transform[:3, :3].T + transform[:3, 3],
            faces[:, ::-1] if mirrored else faces,
        )
    for child in node.get("children", []):
        yield from _node(glb, child, transform)


def _primitive(glb: _Glb, primitive: dict[str, Any]) -> tuple[Floats, Ints]:
    vertices = _accessor(glb, primitive["attributes"]["POSITION"]).astype(np.float64)
    if "indices" in primitive:
        faces = _accessor(glb, primitive["indices"]).astype(np.int64).reshape(-1, 3)
    else:
        faces = np.arange(len(vertices)).reshape(-1, 3)
    if faces.size and int(faces.max()) >= len(vertices):
        raise IndexError(f"vertex {int(faces.max())} of {len(vertices)}")
    return vertices, faces


def _node_transform(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    transform = np.eye(4)
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    scale = np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    transform[:3, :3] = rotation_from_quaternion((w, x, y, z)) * scale
    transform[:3, 3] = node.get("translation", (0, 0, 0))
    return transform


def _accessor(glb: _Glb, index: int) -> NDArray[Any]:
    accessor = glb.document["accessors"][index]
    if "sparse" in accessor or "bufferView" not in accessor:
        raise ValueError("sparse accessors are not supported")
    view = glb.document["bufferViews"][accessor["bufferView"]]
    if glb.document["buffers"][view["buffer"]].get("uri"):
        raise ValueError("external buffers are not supported in a GLB")
    kind = np.dtype(_KINDS[accessor["componentType"]])
    width, count = _WIDTHS[accessor["type"]], int(accessor["count"])
    start, offset = view.get("byteOffset", 0), accessor.get("byteOffset", 0)
    stride = view.get("byteStride", 0) or kind.itemsize * width
    end = offset + stride * (count - 1) + kind.itemsize * width
    if count > 3 * _MOST_ELEMENTS or stride < kind.itemsize * width:
        raise ValueError(f"more than {_MOST_ELEMENTS} vertices and triangles, or some in one place")
    if count < 1 or end > view["byteLength"] or start + end > len(glb.binary):
        raise ValueError("an accessor reaches past the end of the file")
    strides = (stride, kind.itemsize)
    return np.ndarray((count, width), kind, glb.binary, start + offset, strides)
