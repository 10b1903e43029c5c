"""OFF and STL: the two plain formats."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.mesh import Mesh

__all__ = ["read_off", "read_stl"]

_STL_HEADER_BYTES = 84
_STL_FACET = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_off(path: Path) -> Mesh:
    """The mesh of an ASCII OFF file; polygons are cut into fans.

    Raises:
        DataError: not an OFF file, or fewer numbers than its header promises.
    """
    text = re.sub(r"#.*", "", path.read_text(encoding="ascii", errors="replace"))
    if not text.startswith(("OFF", "COFF")):
        raise DataError(f"{path} is not an OFF file", expected="it to start with 'OFF'")
    lines = [
        line.split() for line in text.replace("OFF", "", 1).lstrip("C").splitlines() if line.strip()
    ]
    try:
        vertex_count, face_count = int(lines[0][0]), int(lines[0][1])
        rows = lines[1 : 1 + vertex_count]
        vertices = np.array([row[:3] for row in rows], dtype=np.float64)
        polygons = [
            [int(word) for word in row[1 : 1 + int(row[0])]]
            for row in lines[1 + vertex_count : 1 + vertex_count + face_count]
        ]
        if len(vertices) < vertex_count or len(polygons) < face_count:
            raise ValueError(f"{len(vertices)} vertices and {len(polygons)} faces")
    except (ValueError, IndexError) as error:
        raise DataError(f"{path} is truncated or broken", got=str(error)) from error
    faces = [
        (polygon[0], polygon[i], polygon[i + 1])
        for polygon in polygons
        for i in range(1, len(polygon) - 1)
    ]
    return Mesh(vertices=vertices, faces=np.array(faces).reshape(-1, 3), source=str(path))


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
    return np.frombuffer(content, _STL_FACET, count, _STL_HEADER_BYTES)["corners"].astype(
        np.float64
    )


def _ascii_stl(content: bytes, path: Path) -> NDArray[np.float64]:
    words = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", content)
    if not content.lstrip().startswith(b"solid") or not words or len(words) % 3:
        raise DataError(
            f"{path} is not a complete STL file",
            expected="ASCII 'solid ... endsolid', or binary of the length in its header",
            got=f"{len(content)} bytes",
        )
    try:
        return np.array(words, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError as error:
        raise DataError(f"{path} has a vertex that is not numbers", got=str(error)) from error
