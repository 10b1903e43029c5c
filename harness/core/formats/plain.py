"""Readers of the OFF and STL formats."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.formats.polygons import cut_polygons
from harness.core.mesh import Mesh

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
