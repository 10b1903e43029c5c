"""Stanford PLY: ASCII and binary, read with numpy; binary little-endian written."""

import codecs
import re
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Bytes, Floats, Ints
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path
from harness.core.mesh import Mesh
from harness.files.coloured_mesh import FileColours
from harness.files.polygons import cut_polygons

_KINDS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}

_CHANNELS = ("red", "green", "blue")
#: What programs call the texture coordinates of vertices.
_COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
#: One number for each vertex or face, never a list.
_SINGLE = {*"xyz", *_CHANNELS, *(name for pair in _COORDINATES for name in pair), "texnumber"}
_MOST_HEADER_BYTES = 65_536
_MORE = "more rows than its header tells"
#: Every line ends as the first one does; a binary file may go on with any byte.
_HEADER = re.compile(rb"ply[ \t]*(\r\n|\n|\r)(.*?)(?<=[\r\n])end_header[ \t]*\1", re.DOTALL)

#: A property's values, as runs of equal rows: (n,) for scalars, (n, k) for lists of length k.
Runs = list[NDArray[Any]]


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    kind: str
    count_kind: str = ""  # type of a list's length


@dataclass(frozen=True, slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]


def read_ply(path: Path) -> Mesh:
    """The mesh of a PLY file; polygons become triangles, colours and normals are ignored.

    Raises:
        DataError: not a PLY, truncated, more rows than it has bytes, without x, y, z, in strips of
            triangles, or a point cloud without faces.
    """
    return _surface(path, _read_tables(path))[0]


def read_vertices(path: Path) -> dict[str, Floats] | None:
    """The numbers of a PLY file's vertices by property, if it has no faces; else None.

    Raises:
        DataError: not a PLY, truncated, or without x, y, z.
    """
    tables = _read_tables(path)
    if any(
        len(run)
        for element in ("face", "tristrips")
        for runs in tables.get(element, {}).values()
        for run in runs
    ):
        return None
    _positions(tables, path)
    vertex = tables["vertex"]
    return {name: np.concatenate(runs).astype(np.float64) for name, runs in vertex.items() if runs}


def read_ply_colours(path: Path) -> FileColours:
    """The mesh of a PLY file with the colours and texture coordinates of vertices or faces.

    Raises:
        DataError: as ``read_ply``; colours of a type whose white is not known.
    """
    tables = _read_tables(path)
    mesh, cut, counts = _surface(path, tables)
    # The polygon of each triangle.
    of = np.repeat(np.arange(len(counts)), counts - 2)
    vertex, face = (
        {
            name: np.concatenate([run.ravel() for run in runs])
            for name, runs in tables[element].items()
        }
        for element in ("vertex", "face")
    )
    if (wedges := face.get("texcoord")) is not None:
        if len(wedges) != 2 * counts.sum():
            raise DataError(f"{path} has faces without texture coordinates at all their corners")
        mesh = replace(mesh, uv=wedges.reshape(-1, 2), face_uv=cut)
    for pair in _COORDINATES:
        if mesh.uv is None and all(name in vertex for name in pair):
            uv = np.stack([vertex[name] for name in pair], axis=1)
            mesh = replace(mesh, uv=uv, face_uv=mesh.faces)
    faces = _colours(path, face)
    part = face.get("texnumber", np.zeros(len(counts))).astype(np.int64)
    return FileColours(
        mesh, part[of], (), _colours(path, vertex), None if faces is None else faces[of]
    )


def _colours(path: Path, columns: dict[str, NDArray[Any]]) -> Bytes | None:
    """(N, 3) uint8 sRGB; None if there are no colours."""
    if any(name not in columns for name in _CHANNELS):
        return None
    values = np.stack([columns[name] for name in _CHANNELS], axis=1)
    white = {"u1": 255, "u2": 65535, "f4": 1, "f8": 1}.get(values.dtype.str[1:])
    if white is None or not (values >= 0).all() or values.max() > white:
        raise DataError(
            f"{path} has colours of another type than can be read",
            expected="uchar, ushort, or float from 0 to 1",
            got=f"{values.dtype} from {values.min():g} to {values.max():g}",
            hint="Export it with colours of 8 bits",
        )
    return np.round(values * (255 / white)).astype(np.uint8)


def _surface(path: Path, tables: dict[str, dict[str, Runs]]) -> tuple[Mesh, Ints, Ints]:
    """The mesh, (T, 3) places of its triangles among all corners, and (F,) corners of polygons."""
    if "tristrips" in tables:
        raise DataError(
            f"{path} holds its faces as tristrips, strips of triangles, which are not read",
            expected="an element 'face' with a list 'vertex_indices'",
            hint="Export it again with plain faces",
        )
    vertices = _positions(tables, path)
    try:
        corners, counts = _polygons(tables)
        cut = cut_polygons(vertices, corners, counts)
    except ValueError as error:
        raise DataError(f"{path} is truncated or broken", got=str(error)) from error
    except DataError as error:
        raise error.located(path) from error
    return Mesh(vertices=vertices, faces=corners[cut], source=str(path)), cut, counts


def _read_tables(path: Path) -> dict[str, dict[str, Runs]]:
    """The columns of each element, by their names."""
    content = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    header = _HEADER.match(content[:_MOST_HEADER_BYTES])
    if header is None:
        raise DataError(f"{path} is not a PLY file", expected="a header 'ply ... end_header'")
    try:
        order, elements = _header(header[2].decode("ascii", errors="replace"))
        rows, size = sum(element.count for element in elements), len(content) - header.end()
        if rows > size:
            raise ValueError(f"{rows} rows in {size} bytes")
    except (KeyError, ValueError, IndexError) as error:
        raise DataError(
            f"{path} has a header that cannot be read", got=f"{type(error).__name__}: {error}"
        ) from error
    try:
        if order:
            return _binary_tables(content, header.end(), elements, order)
        return _ascii_tables(content[header.end() :], elements)
    except (ArithmeticError, IndexError, TypeError, ValueError) as error:
        # numpy adds advice to a programmer after a semicolon.
        got = str(error).split(";")[0]
        raise DataError(f"{path} is truncated or broken", got=got) from error


def _header(text: str) -> tuple[str, list[_Element]]:
    """Byte order (empty for ASCII) and elements."""
    layout = ""
    elements: list[_Element] = []
    for words in filter(None, map(str.split, text.splitlines())):
        if words[0] == "format":
            layout = words[1]
        elif words[0] == "element":
            elements.append(_Element(words[1], int(words[2]), []))
            if elements[-1].count < 0:
                raise ValueError(" ".join(words))
        elif words[:2] == ["property", "list"]:
            if words[4] in _SINGLE:
                raise ValueError(f"a list as {words[4]}")
            found = _Property(words[4], _KINDS[words[3]], _KINDS[words[2]])
            elements[-1].properties.append(found)
        elif words[0] == "property":
            elements[-1].properties.append(_Property(words[2], _KINDS[words[1]]))
    for group in (elements, *(element.properties for element in elements)):
        names = [each.name for each in group]
        if len(set(names)) < len(names):
            raise ValueError(f"two of one name among {', '.join(names)}")
    return _BYTE_ORDERS[layout], elements


def _positions(tables: dict[str, dict[str, Runs]], path: Path) -> NDArray[np.float64]:
    columns = tables.get("vertex", {})
    missing = [axis for axis in "xyz" if not columns.get(axis)]
    if missing:
        raise DataError(f"{path} has no vertices with {', '.join(missing)}")
    return np.stack([np.concatenate(columns[axis]) for axis in "xyz"], axis=1).astype(np.float64)


def _polygons(tables: dict[str, dict[str, Runs]]) -> tuple[Ints, Ints]:
    """(C,) vertex indices of the corners of all faces, and (F,) how many each face has."""
    columns = tables.get("face", {})
    runs = columns.get("vertex_indices", columns.get("vertex_index", []))
    if not runs and any(columns.values()):
        raise ValueError(f"faces have {', '.join(columns)}, but no vertex_indices")
    short = [shape for run in runs if (shape := run.shape[1] if run.ndim == 2 else 1) < 3]
    if short:
        raise ValueError(f"a face of {short[0]} corners")
    corners = np.concatenate([run.ravel() for run in runs] or [np.zeros(0, np.int64)])
    if corners.dtype.kind not in "iu":
        raise ValueError("vertex indices are not whole numbers")
    counts = [np.full(len(run), run.shape[1]) for run in runs] or [np.zeros(0, np.int64)]
    return corners.astype(np.int64), np.concatenate(counts)


def _binary_tables(
    content: bytes, offset: int, elements: list[_Element], order: str
) -> dict[str, dict[str, Runs]]:
    tables: dict[str, dict[str, Runs]] = {}
    for element in elements:
        columns: dict[str, Runs] = {prop.name: [] for prop in element.properties}
        tables[element.name] = columns
        left = run = element.count if element.properties else 0
        while left:
            # Guess that the next rows have lists as long as the next row's; all of them at first,
            # as in a triangle mesh, then ever more again after each wrong guess.
            row = _row_type(content, offset, element, order)
            fitting = min(run, left, (len(content) - offset) // row.itemsize)
            if fitting == 0:
                raise ValueError(f"{element.count - left} of {element.count} {element.name} rows")
            table = np.frombuffer(content, row, fitting, offset)
            alike = np.ones(fitting, dtype=bool)
            for prop in element.properties:
                if prop.count_kind:
                    counts = table[f"#{prop.name}"]
                    alike &= counts == counts[0]
            taken = fitting if alike.all() else int(np.argmin(alike))
            for name, runs in columns.items():
                runs.append(table[name][:taken])
            offset += taken * row.itemsize
            left -= taken
            run = 2 * run if taken == fitting else 1
    if content[offset:].strip(b" \t\r\n\0"):
        raise ValueError(_MORE)
    return tables


def _row_type(content: bytes, offset: int, element: _Element, order: str) -> np.dtype[Any]:
    """The layout of the row at an offset; a list's length is a field named with a '#'."""
    fields: list[tuple[Any, ...]] = []
    for prop in element.properties:
        kind = np.dtype(order + prop.kind)
        if not prop.count_kind:
            fields.append((prop.name, kind))
            offset += kind.itemsize
            continue
        count_kind = np.dtype(order + prop.count_kind)
        length = int(np.frombuffer(content, count_kind, 1, offset)[0])
        fields += [(f"#{prop.name}", count_kind), (prop.name, kind, (length,))]
        offset += count_kind.itemsize + length * kind.itemsize
    return np.dtype(fields)


def _ascii_tables(body: bytes, elements: list[_Element]) -> dict[str, dict[str, Runs]]:
    lines = [line for line in body.decode("ascii", errors="replace").splitlines() if line.strip()]
    tables: dict[str, dict[str, Runs]] = {}
    for element in elements:
        rows, lines = lines[: element.count], lines[element.count :]
        if len(rows) < element.count:
            raise ValueError(f"{len(rows)} of {element.count} {element.name} rows")
        columns: dict[str, Runs] = {prop.name: [] for prop in element.properties}
        for lengths, run in groupby(rows, partial(_list_lengths, element)):
            table = np.loadtxt(list(run), dtype=np.float64, comments=None, ndmin=2)
            _split_columns(table, element, lengths, columns)
        tables[element.name] = columns
    if lines:
        raise ValueError(_MORE)
    return tables


def _list_lengths(element: _Element, row: str) -> tuple[int, ...]:
    """How long each list property is in an ASCII row."""
    if not any(prop.count_kind for prop in element.properties):
        return ()
    words = row.split()
    lengths: list[int] = []
    position = 0
    for prop in element.properties:
        if prop.count_kind:
            lengths.append(int(words[position]))
            position += lengths[-1]
        position += 1
    return tuple(lengths)


def _split_columns(
    table: NDArray[np.float64],
    element: _Element,
    lengths: tuple[int, ...],
    columns: dict[str, Runs],
) -> None:
    """Append the columns of equal ASCII rows to the properties' runs."""
    width = len(element.properties) + sum(lengths)
    if table.shape[1] != width or min(lengths, default=0) < 0:
        raise ValueError(f"a {element.name} row of {table.shape[1]} numbers instead of {width}")
    remaining = list(lengths)
    position = 0
    for prop in element.properties:
        if not prop.count_kind:
            values = table[:, position]
            with np.errstate(invalid="ignore"):
                whole = values.astype(prop.kind if prop.kind[0] in "iu" else np.int64)
            is_whole = prop.kind[0] in "iu" and np.array_equal(whole, values)
            columns[prop.name].append(whole if is_whole else values)
            position += 1
            continue
        length = remaining.pop(0)
        values = table[:, position + 1 : position + 1 + length]
        if prop.kind[0] in "iu":
            if not np.isfinite(values).all() or (values != np.floor(values)).any():
                raise ValueError(f"{prop.name} are not whole numbers")
            values = values.astype(np.int64)
        columns[prop.name].append(values)
        position += 1 + length


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
