"""OFF and STL: what is read, and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.files.mesh_files import load_mesh

OFF = """\
OFF
# a pyramid
5 5 0

0 0 0
1 0 0  # a comment
1 1 0
0 1 0
0.5 0.5 1e0
4 0 3 2 1
3 0 1 4 255 0 0
3 1 2 4
3 2 3 4
3 3 0 4
"""
FACES = [[0, 3, 2], [0, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]

TRIANGLES = np.array(
    [
        [[0, 0, 0], [0, 1, 0], [1, 0, 0]],
        [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
        [[0, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ],
    dtype=float,
)


def read(folder: Path, suffix: str, content: bytes | str) -> Mesh:
    path = folder / f"mesh.{suffix}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_mesh(path)


@pytest.mark.parametrize(
    "content", [OFF, OFF.replace("\n", "\r\n"), "# first\n" + OFF, OFF.replace("OFF\n", "OFF ")]
)
def test_off_with_polygons_comments_and_colours(tmp_path: Path, content: str) -> None:
    mesh = read(tmp_path, "off", content)

    assert mesh.vertices.tolist()[4] == [0.5, 0.5, 1]
    assert mesh.faces.tolist() == FACES


def test_off_with_vertex_colours(tmp_path: Path) -> None:
    content = "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 0 0 255\n0 1 0 0 0 0 255\n3 0 1 2\n"

    assert read(tmp_path, "off", content).vertices.tolist()[1] == [1, 0, 0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "not an OFF file"),
        ("OFFICE 1 2 3", "not an OFF file"),
        ("OFF\n", "truncated or broken"),
        ("OFF\nfive 5 0\n", "truncated or broken .*'five'"),
        (OFF[: OFF.index("3 2 3 4")], "truncated or broken .*5 of 5 vertices, 3 of 5 faces"),
        (OFF[: OFF.index("1 1 0")], "truncated or broken .*2 of 5 vertices, 0 of 5 faces"),
        (OFF + "3 0 1 2\n", "truncated or broken .*5 of 5 vertices, 6 of 5 faces"),
        (OFF.replace("3 1 2 4", "3 1 2"), "truncated or broken .*a face row '3 1 2'"),
        (OFF.replace("3 1 2 4", "2 1 2"), "truncated or broken .*a face row '2 1 2'"),
        (OFF.replace("3 1 2 4", "3 1 2.5 4"), "truncated or broken .*'2.5'"),
        (OFF.replace("1 1 0", "1 one 0"), "truncated or broken .*'one'"),
        (OFF.replace("1 1 0", "1 1"), "truncated or broken"),
        (OFF.replace("1 1 0", "1 nan 0"), "1 non-finite vertices"),
        (OFF.replace("3 1 2 4", "3 1 2 5"), "vertex index out of range .*got 5"),
        ("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "has no faces .*point cloud"),
    ],
)
def test_off_defects(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(tmp_path, "off", content)


def binary_stl(triangles: np.ndarray = TRIANGLES, title: bytes = b"") -> bytes:
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *t.ravel(), 0) for t in triangles)
    return title.ljust(80, b" ") + struct.pack("<I", len(triangles)) + facets


def ascii_stl() -> str:
    facets = "".join(
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x:e} {y:e} {z:e}\n" for x, y, z in triangle)
        + " endloop\nendfacet\n"
        for triangle in TRIANGLES
    )
    return f"solid made by hand\n{facets}endsolid made by hand\n"


@pytest.mark.parametrize(
    "content",
    [binary_stl(), binary_stl(title=b"solid but binary"), ascii_stl()],
    ids=["binary", "solid binary", "ascii"],
)
def test_stl_corners_are_joined_where_they_are_equal(tmp_path: Path, content: bytes | str) -> None:
    mesh = read(tmp_path, "stl", content)

    assert mesh.vertices.shape == (4, 3)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], TRIANGLES)
    assert mesh.signed_volume == pytest.approx(1 / 6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a complete STL file"),
        (binary_stl()[:-1], "not a complete STL file .*got 283 bytes"),
        (binary_stl()[:50], "not a complete STL file"),
        (binary_stl() + b"more", "not a complete STL file"),
        (binary_stl(TRIANGLES[:0]), "has no faces"),
        (ascii_stl()[:-30], "not a complete STL file"),
        (ascii_stl()[: len(ascii_stl()) // 2], "not a complete STL file"),
        (ascii_stl().replace("endfacet", "", 1), "not a complete STL file"),
        (ascii_stl().replace("0.000000e+00", "zero", 1), "vertex that is not numbers .*zero"),
        ("solid empty\nendsolid empty\n", "has no faces"),
        (binary_stl(TRIANGLES * np.nan), "non-finite vertices"),
        (binary_stl(TRIANGLES * 0), "no measurable surface"),
    ],
)
def test_stl_defects(tmp_path: Path, content: bytes | str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(tmp_path, "stl", content)
