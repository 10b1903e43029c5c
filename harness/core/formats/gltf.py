"""Binary glTF (GLB): the triangles of all nodes, in the file's own axes (+Y up, metres)."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.frames import rotation_from_quaternion
from harness.core.mesh import Mesh

__all__ = ["read_glb"]

_KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_TRIANGLES = 4
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


def read_glb(path: Path) -> Mesh:
    """The geometry of a GLB file, all nodes of its scenes joined; textures are not read.

    Raises:
        DataError: not a GLB, truncated, compressed (Draco, meshopt) or with sparse accessors.
    """
    document, binary = _chunks(path)
    compressed = [
        name for name in document.get("extensionsRequired", []) if "KHR_texture" not in name
    ]
    if compressed:
        raise DataError(
            f"{path} needs {', '.join(compressed)}", hint="Export it again without compression"
        )
    try:
        pieces = [
            piece
            for scene in document.get("scenes", [{"nodes": list(range(len(document["nodes"])))}])
            for node in scene.get("nodes", [])
            for piece in _node(document, binary, node, np.eye(4))
        ]
    except (KeyError, IndexError, ValueError) as error:
        raise DataError(
            f"{path} is not a readable GLB", got=f"{type(error).__name__}: {error}"
        ) from error
    if not pieces:
        raise DataError(f"{path} has no triangles", expected="a mesh in one of its scenes")
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in pieces[:-1]])
    return Mesh(
        vertices=np.concatenate([vertices for vertices, _ in pieces]),
        faces=np.concatenate(
            [faces + start for (_, faces), start in zip(pieces, offsets, strict=True)]
        ),
        source=str(path),
    )


def _chunks(path: Path) -> tuple[dict[str, Any], bytes]:
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
    document: dict[str, Any] = {}
    binary = b""
    position = 12
    while position + 8 <= length:
        size, kind = struct.unpack_from("<II", content, position)
        chunk = content[position + 8 : position + 8 + size]
        if kind == _JSON_CHUNK:
            document = json.loads(chunk)
        elif kind == _BINARY_CHUNK:
            binary = chunk
        position += 8 + size
    return document, binary


def _node(
    document: dict[str, Any], binary: bytes, index: int, parent: NDArray[np.float64]
) -> list[tuple[NDArray[np.float64], NDArray[np.int64]]]:
    node = document["nodes"][index]
    transform = parent @ _node_transform(node)
    pieces = []
    if "mesh" in node:
        for primitive in document["meshes"][node["mesh"]]["primitives"]:
            if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                continue
            local = _accessor(document, binary, primitive["attributes"]["POSITION"])
            vertices = local @ transform[:3, :3].T + transform[:3, 3]
            if "indices" in primitive:
                faces = _accessor(document, binary, primitive["indices"]).reshape(-1, 3)
            else:
                faces = np.arange(len(vertices)).reshape(-1, 3)
            faces = faces.astype(np.int64)
            # A mirrored node turns its triangles inside out.
            pieces.append(
                (vertices, faces if np.linalg.det(transform[:3, :3]) > 0 else faces[:, ::-1])
            )
    for child in node.get("children", []):
        pieces += _node(document, binary, child, transform)
    return pieces


def _node_transform(node: dict[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    transform = np.eye(4)
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    transform[:3, :3] = rotation_from_quaternion((w, x, y, z)) * np.array(
        node.get("scale", (1, 1, 1))
    )
    transform[:3, 3] = node.get("translation", (0, 0, 0))
    return transform


def _accessor(document: dict[str, Any], binary: bytes, index: int) -> NDArray[np.float64]:
    accessor = document["accessors"][index]
    if "sparse" in accessor or "bufferView" not in accessor:
        raise ValueError("sparse accessors are not supported")
    view = document["bufferViews"][accessor["bufferView"]]
    if document["buffers"][view["buffer"]].get("uri"):
        raise ValueError("external buffers are not supported in a GLB")
    kind = np.dtype(_KINDS[accessor["componentType"]])
    width = _WIDTHS[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    stride = view.get("byteStride", 0) or kind.itemsize * width
    if start + stride * (accessor["count"] - 1) + kind.itemsize * width > len(binary):
        raise ValueError("an accessor reaches past the end of the file")
    table = np.ndarray((accessor["count"], width), kind, binary, start, (stride, kind.itemsize))
    return table.astype(np.float64) if kind.kind == "f" else table.astype(np.int64)
