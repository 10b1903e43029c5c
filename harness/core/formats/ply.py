"""Stanford PLY: ASCII and binary, read with numpy; binary little-endian written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.files import atomic_path
from harness.core.mesh import Mesh

__all__ = ["read_ply", "write_ply"]

_KINDS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    kind: str
    count_kind: str | None  # of a list property


@dataclass(frozen=True, slots=True)
class _Element:
    name: str
    count: int
    properties: tuple[_Property, ...]


def read_ply(path: Path) -> Mesh:
    """The mesh of a PLY file; polygons are cut into fans, colours and normals are ignored.

    Raises:
        DataError: not a PLY, truncated, without x, y, z, or a point cloud without faces.
    """
    content = path.read_bytes()
    elements, layout, body = _header(content, path)
    try:
        tables = (
            _ascii_tables(content[body:], elements)
            if layout == "ascii"
            else _binary_tables(content, body, elements, "<" if "little" in layout else ">")
        )
        columns = tables["vertex"]
        vertices = np.stack([columns[axis] for axis in "xyz"], axis=1).astype(np.float64)
    except (KeyError, ValueError, IndexError) as error:
        raise DataError(
            f"{path} is truncated or not a PLY mesh", got=f"{type(error).__name__}: {error}"
        ) from error
    polygons = tables.get("face", {})
    indices = polygons.get("vertex_indices", polygons.get("vertex_index"))
    faces = np.zeros((0, 3), np.int32) if indices is None else indices
    return Mesh(vertices=vertices, faces=faces, source=str(path))


def _header(content: bytes, path: Path) -> tuple[list[_Element], str, int]:
    end = content.find(b"end_header")
    if not content.startswith(b"ply") or end < 0:
        raise DataError(f"{path} is not a PLY file", expected="a header 'ply ... end_header'")
    body = content.index(b"\n", end) + 1
    elements: list[_Element] = []
    layout = ""
    for line in content[:end].decode("ascii", errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            layout = words[1]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2]), ()))
        elif words[:1] == ["property"]:
            is_list = words[1] == "list"
            count_kind = _KINDS[words[2]] if is_list else None
            found = _Property(words[-1], _KINDS[words[3 if is_list else 1]], count_kind)
            last = elements.pop()
            elements.append(_Element(last.name, last.count, (*last.properties, found)))
    return elements, layout, body


def _binary_tables(
    content: bytes, offset: int, elements: list[_Element], order: str
) -> dict[str, dict[str, NDArray]]:
    tables: dict[str, dict[str, NDArray]] = {}
    for element in elements:
        lists = [prop for prop in element.properties if prop.count_kind]
        if element.count == 0:
            tables[element.name] = {}
            continue
        # Guess that every list is as long as the first row's; true for triangle meshes.
        lengths = _first_row_lengths(content, offset, element, order)
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        for prop in element.properties:
            if prop.count_kind:
                fields.append((f"#{prop.name}", order + prop.count_kind))
                fields.append((prop.name, order + prop.kind, (lengths[prop.name],)))
            else:
                fields.append((prop.name, order + prop.kind))
        row = np.dtype(fields)
        table = None
        if len(content) >= offset + row.itemsize * element.count:
            table = np.frombuffer(content, row, element.count, offset)
        if table is not None and all((table[f"#{p.name}"] == lengths[p.name]).all() for p in lists):
            offset += row.itemsize * element.count
            columns = {prop.name: table[prop.name] for prop in element.properties}
        else:
            columns, offset = _ragged_rows(content, offset, element, order)
        tables[element.name] = {
            name: _fans([column]) if column.ndim == 2 else column
            for name, column in columns.items()
        }
    return tables


def _first_row_lengths(
    content: bytes, offset: int, element: _Element, order: str
) -> dict[str, int]:
    lengths = {}
    for prop in element.properties:
        if prop.count_kind:
            count = int(np.frombuffer(content, order + prop.count_kind, 1, offset)[0])
            lengths[prop.name] = count
            offset += np.dtype(prop.count_kind).itemsize + count * np.dtype(prop.kind).itemsize
        else:
            offset += np.dtype(prop.kind).itemsize
    return lengths


def _ragged_rows(
    content: bytes, offset: int, element: _Element, order: str
) -> tuple[dict[str, NDArray], int]:
    """Rows whose lists differ in length, read one by one."""
    rows: dict[str, list[NDArray]] = {prop.name: [] for prop in element.properties}
    for _ in range(element.count):
        for prop in element.properties:
            count = 1
            if prop.count_kind:
                count = int(np.frombuffer(content, order + prop.count_kind, 1, offset)[0])
                offset += np.dtype(prop.count_kind).itemsize
            rows[prop.name].append(np.frombuffer(content, order + prop.kind, count, offset))
            offset += count * np.dtype(prop.kind).itemsize
    columns = {
        prop.name: _fans(rows[prop.name]) if prop.count_kind else np.concatenate(rows[prop.name])
        for prop in element.properties
    }
    return {name: column for name, column in columns.items()}, offset


def _fans(polygons: list[NDArray]) -> NDArray:
    """(F, 3) triangles of polygons given as rows or as blocks of equal rows."""
    triangles = [np.zeros((0, 3), np.int64)]
    for block in polygons:
        rows = np.atleast_2d(block)
        for corner in range(1, rows.shape[1] - 1):
            triangles.append(rows[:, [0, corner, corner + 1]])
    return np.concatenate(triangles)


def _ascii_tables(body: bytes, elements: list[_Element]) -> dict[str, dict[str, NDArray]]:
    lines = [line for line in body.splitlines() if line.strip()]
    tables: dict[str, dict[str, NDArray]] = {}
    start = 0
    for element in elements:
        rows = lines[start : start + element.count]
        if len(rows) < element.count:
            raise ValueError(f"{len(rows)} of {element.count} {element.name} rows")
        start += element.count
        tables[element.name] = _ascii_columns(rows, element)
    return tables


def _ascii_columns(rows: list[bytes], element: _Element) -> dict[str, NDArray]:
    if not any(prop.count_kind for prop in element.properties):
        values = np.array([row.split() for row in rows], dtype=np.float64)
        return {prop.name: values[:, i] for i, prop in enumerate(element.properties)}
    columns: dict[str, list[NDArray]] = {p.name: [] for p in element.properties if p.count_kind}
    for row in rows:
        words = row.split()
        position = 0
        for prop in element.properties:
            if prop.count_kind:
                count = int(words[position])
                values = np.array(words[position + 1 : position + 1 + count], dtype=np.float64)
                columns[prop.name].append(values)
                position += 1 + count
            else:
                position += 1
    return {name: _fans(lists).astype(np.int64) for name, lists in columns.items()}


def write_ply(path: Path, mesh: Mesh) -> None:
    """Write vertices (float64) and faces as binary little-endian PLY, atomically."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(mesh.vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(mesh.faces), dtype=[("n", "u1"), ("corners", "<i4", (3,))])
    faces["n"] = 3
    faces["corners"] = mesh.faces
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(header.encode("ascii"))
        stream.write(mesh.vertices.astype("<f8").tobytes())
        stream.write(faces.tobytes())
