"""Coloured meshes on disk: what another program reads is what was written."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.files.coloured_mesh import ColouredMesh, save_coloured
from harness.files.mesh_files import load_mesh


@pytest.fixture
def tetrahedron() -> ColouredMesh:
    """Four vertices in red, green, blue and a middle grey; the last was not seen."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.5]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    colours = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [188, 188, 188]], dtype=np.uint8)
    return ColouredMesh(Mesh(vertices, faces), colours, np.array([True, True, True, False]))


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_the_surface_is_read_back(tmp_path: Path, tetrahedron: ColouredMesh, suffix: str):
    path = tmp_path / f"person{suffix}"
    save_coloured(path, tetrahedron)
    read = load_mesh(path)
    np.testing.assert_array_equal(read.vertices, tetrahedron.mesh.vertices)
    np.testing.assert_array_equal(read.faces, tetrahedron.mesh.faces)


def test_another_program_reads_the_colours_of_a_ply(tmp_path: Path, tetrahedron: ColouredMesh):
    import trimesh

    save_coloured(tmp_path / "person.ply", tetrahedron)
    read = trimesh.load(tmp_path / "person.ply", process=False)
    np.testing.assert_array_equal(read.visual.vertex_colors[:, :3], tetrahedron.colours)


def test_a_glb_holds_linear_colours_normals_and_bounds(tmp_path: Path, tetrahedron: ColouredMesh):
    import trimesh

    path = tmp_path / "person.glb"
    save_coloured(path, tetrahedron)
    content = path.read_bytes()
    magic, version, length, size, kind = struct.unpack_from("<4sIIII", content)
    assert (magic, version, length, kind) == (b"glTF", 2, len(content), 0x4E4F534A)
    document = json.loads(content[20 : 20 + size])
    assert document["extensionsUsed"] == ["KHR_materials_unlit"]
    assert document["accessors"][0]["max"] == [1.0, 1.0, 1.5]
    binary = content[20 + size + 8 :]
    view = document["bufferViews"][document["accessors"][2]["bufferView"]]
    stored = np.frombuffer(binary, "<u2", 16, view["byteOffset"]).reshape(4, 4) / 65535.0
    # sRGB 188 is half of the light of white.
    expected = [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [0.503, 0.503, 0.503, 1]]
    np.testing.assert_allclose(stored, expected, atol=1e-3)
    (read,) = trimesh.load(path, process=False).geometry.values()
    assert len(read.faces) == 4
    np.testing.assert_allclose(np.linalg.norm(read.vertex_normals, axis=1), 1.0, atol=1e-6)


def test_what_cannot_be_written_is_refused(tmp_path: Path, tetrahedron: ColouredMesh):
    with pytest.raises(DataError, match=r"expected \.ply or \.glb"):
        save_coloured(tmp_path / "person.obj", tetrahedron)
    with pytest.raises(DataError, match="one colour for each vertex"):
        ColouredMesh(tetrahedron.mesh, tetrahedron.colours[:3], tetrahedron.seen)


def test_the_share_that_photos_show(tetrahedron: ColouredMesh):
    assert tetrahedron.seen_share == 0.75
