"""PLY: every layout reads alike, every defect has its own error."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.files.ply import read_ply, write_ply

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]])
POLYGONS = [[0, 3, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
#: The base is cut into a fan from its first corner; the order of the faces is the file's.
FACES = [[0, 3, 2], [0, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]

HEADER = """\
ply
format {layout} 1.0
comment element face 99
element vertex {vertices}
property float x
property float y
property float z
property uchar red
element face {faces}
property uchar flag
property list uchar int {name}
end_header
"""


def header(layout: str, name: str = "vertex_indices", vertices: int = 5, faces: int = 5) -> bytes:
    return HEADER.format(layout=layout, name=name, vertices=vertices, faces=faces).encode()


def ascii_ply(name: str = "vertex_indices") -> bytes:
    rows = [f"{x} {y} {z} 255" for x, y, z in VERTICES]
    rows += [f"7 {len(p)} {' '.join(map(str, p))}" for p in POLYGONS]
    return header("ascii", name) + "\n".join(rows).encode() + b"\n"


def binary_ply(order: str, polygons: list[list[int]] = POLYGONS) -> bytes:
    layout = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    body = b"".join(struct.pack(f"{order}3fB", *vertex, 255) for vertex in VERTICES)
    body += b"".join(struct.pack(f"{order}BB{len(p)}i", 7, len(p), *p) for p in polygons)
    return header(layout, faces=len(polygons)) + body


def read(folder: Path, content: bytes) -> Mesh:
    path = folder / "mesh.ply"
    path.write_bytes(content)
    return read_ply(path)


@pytest.mark.parametrize(
    "content",
    [
        ascii_ply(),
        ascii_ply("vertex_index"),
        ascii_ply().replace(b"\n", b"\r\n"),
        binary_ply("<"),
        binary_ply(">"),
    ],
    ids=["ascii", "vertex_index", "crlf", "little", "big"],
)
def test_polygons_colours_and_flags_in_every_layout(tmp_path: Path, content: bytes) -> None:
    mesh = read(tmp_path, content)

    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    assert mesh.faces.tolist() == FACES


@pytest.mark.parametrize("seed", range(5))
def test_ragged_rows_are_read_as_one_by_one(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Parts of the base, and triangles: fans are right for both.
    polygons = [
        [[0, 1, 2, 3], [2, 3, 0], [4, 1, 3], [3, 0, 1, 2]][rng.integers(4)] for _ in range(100)
    ]

    mesh = read(tmp_path, binary_ply("<", polygons))

    expected = [[p[0], p[i], p[i + 1]] for p in polygons for i in range(1, len(p) - 1)]
    assert mesh.faces.tolist() == expected


def test_elements_that_are_not_asked_for_are_stepped_over(tmp_path: Path) -> None:
    content = (
        "ply\nformat ascii 1.0\nelement note 2\nproperty list uchar float values\n"
        "element vertex 3\nproperty double x\nproperty double y\nproperty double z\n"
        "element face 1\nproperty list uchar uint vertex_indices\n"
        "property list uchar float texcoord\nelement edge 0\nproperty int a\nend_header\n"
        "0\n2 0.5 0.5\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 1 0 0 1\n"
    )

    assert read(tmp_path, content.encode()).faces.tolist() == [[0, 1, 2]]


def test_what_is_written_is_read_back_exactly(tmp_path: Path) -> None:
    mesh = Mesh(VERTICES * np.pi, np.array(FACES))
    path = tmp_path / "sub" / "mesh.ply"

    write_ply(path, mesh)
    back = read_ply(path)

    np.testing.assert_array_equal(back.vertices, mesh.vertices)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    assert [file.name for file in path.parent.iterdir()] == ["mesh.ply"]


def swapped(old: str, new: str) -> bytes:
    content = ascii_ply().decode()
    assert old in content
    return content.replace(old, new, 1).encode()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a PLY file"),
        (b"solid ply", "not a PLY file"),
        (b"ply\nformat ascii 1.0\n", "not a PLY file"),
        (b"ply\nformat ascii 1.0\nend_header", "not a PLY file"),
        (swapped("ascii", "binary_middle_endian"), "header that cannot be read .*middle"),
        (swapped("float x", "quad x"), "header that cannot be read .*quad"),
        (swapped("vertex 5", "vertex five"), "header that cannot be read .*five"),
        (swapped("vertex 5", "vertex -5"), "header that cannot be read .*-5"),
        (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "header that cannot be read"),
        (ascii_ply()[:-20], "truncated or broken"),
        (header("ascii") + b"0 0 0 255\n", "truncated or broken .*1 of 5 vertex rows"),
        (swapped("0.0 0.0 0.0 255", "0.0 0.0 x 255"), "truncated or broken .*'x'"),
        (swapped("0.0 0.0 0.0 255", "0.0 0.0 255"), "truncated or broken"),
        (swapped("7 3 0 1 4", "7 3 0 1.5 4"), "truncated or broken .*not whole numbers"),
        (swapped("7 3 0 1 4", "7 3 0 nan 4"), "truncated or broken .*not whole numbers"),
        (swapped("7 3 0 1 4", "7 2 0 1"), "truncated or broken .*a face of 2 corners"),
        (swapped("7 3 0 1 4", "7 -1"), "truncated or broken .*a face row"),
        (
            swapped("7 3 0 1 4", "7 3 0 1"),
            "truncated or broken .*columns changed from 4 to 5 at row 2\\)$",
        ),
        (swapped("7 3 0 1 4", "7"), "truncated or broken"),
        (binary_ply("<")[:-1], "truncated or broken .*4 of 5 face rows"),
        (binary_ply(">")[: len(header("binary_big_endian")) + 20], "truncated .*1 of 5 vertex"),
        (swapped("float y", "float why"), "no vertices with y"),
        (header("ascii", vertices=0, faces=0), "no vertices with x, y, z"),
        (swapped("element face 5", "element polygon 5"), "has no faces .*point cloud"),
        (swapped("element face 5", "element face 0"), "more rows than its header tells"),
        (swapped("element face 5", "element face 4"), "more rows than its header tells"),
        (binary_ply("<") + b"\1", "more rows than its header tells"),
        (header("ascii", faces=0) + 5 * b"0 0 0 255\n", "has no faces .*point cloud"),
        (swapped("float y", "float x"), "two of one name among x, x"),
        (swapped("end_header", "element face 0\nend_header"), "two of one name among vertex, face"),
        (swapped("list uchar int vertex", "int vertex"), "truncated or broken"),
        (swapped("7 3 0 1 4", "7 3 0 1 5"), "vertex index out of range .*got 5"),
        (swapped("0.0 0.0 0.0 255", "0.0 nan 0.0 255"), "1 non-finite vertices"),
    ],
)
def test_each_defect_has_its_own_error(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(tmp_path, content)


def test_an_index_too_large_for_32_bits_is_not_wrapped(tmp_path: Path) -> None:
    content = binary_ply("<").replace(b"list uchar int", b"list uchar uint")
    content = content[:-4] + struct.pack("<I", 2**32 - 1)

    with pytest.raises(DataError, match="out of range .*got 4294967295"):
        read(tmp_path, content)


def test_faces_given_as_plain_numbers_are_no_polygons(tmp_path: Path) -> None:
    content = (
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        b"property float z\nelement face 1\nproperty int vertex_indices\nend_header\n"
        b"0 0 0\n1 0 0\n0 1 0\n2\n"
    )

    with pytest.raises(DataError, match="a face of 1 corners"):
        read(tmp_path, content)


def test_strips_of_triangles_are_refused_by_name(tmp_path: Path) -> None:
    rows = ascii_ply().decode().split("7 4 0")[0]
    for name in ("vertex_indices", "vertex_index"):
        head = rows.replace("element face 5", "element tristrips 1").replace("vertex_indices", name)
        with pytest.raises(DataError, match="faces as tristrips.*plain faces"):
            read(tmp_path, (head + "7 6 0 1 4 2 3 -1\n").encode())


def test_faces_under_another_name_are_not_left_out(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="faces have flag, corners, but no vertex_indices"):
        read(tmp_path, ascii_ply("corners"))


@pytest.mark.parametrize("kind", ["float", "double"])
def test_whole_numbers_of_a_float_type_are_no_indices(tmp_path: Path, kind: str) -> None:
    content = swapped("list uchar int", f"list uchar {kind}")
    with pytest.raises(DataError, match="vertex indices are not whole numbers"):
        read(tmp_path, content)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_marks_and_ends_of_lines(tmp_path: Path, end: bytes, mark: bytes) -> None:
    mesh = read(tmp_path, mark + ascii_ply().replace(b"\n", end))
    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    # A binary file whose first number starts with the byte of a line's end.
    head = header("binary_little_endian", vertices=5, faces=1).replace(b"\n", end)
    first = b"\n\r\x80\x3f" + struct.pack("<2fB", 0, 0, 1)
    body = first + b"".join(struct.pack("<3fB", *vertex, 9) for vertex in VERTICES[1:])
    mesh = read(tmp_path, mark + head + body + struct.pack("<BB3i", 7, 3, 1, 2, 4))
    assert mesh.vertices[0, 0] == np.frombuffer(b"\n\r\x80\x3f", "<f4")[0]
