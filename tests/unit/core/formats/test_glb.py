"""GLB: small files made by hand, with moved nodes and interleaved buffers."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.formats import gltf
from harness.core.formats.gltf import read_glb
from harness.core.mesh import Mesh

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype="<u2")
#: Positions with two floats of texture coordinates after each, then the indices.
INTERLEAVED = b"".join(point.tobytes() + struct.pack("<2f", 7, 7) for point in POINTS)
BINARY = INTERLEAVED + TRIANGLES.tobytes()


def document() -> dict:
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 80, "byteStride": 20},
            {"buffer": 0, "byteOffset": 80, "byteLength": 24},
        ],
        "buffers": [{"byteLength": len(BINARY)}],
    }


def glb(content: dict | bytes, binary: bytes = BINARY) -> bytes:
    text = content if isinstance(content, bytes) else json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def read(folder: Path, content: bytes) -> Mesh:
    path = folder / "mesh.glb"
    path.write_bytes(content)
    return read_glb(path)


def read_changed(folder: Path, change: Callable[[dict], object]) -> Mesh:
    changed = document()
    change(changed)
    return read(folder, glb(changed))


def test_interleaved_positions_and_short_indices(tmp_path: Path) -> None:
    mesh = read(tmp_path, glb(document()))

    np.testing.assert_array_equal(mesh.vertices, POINTS)
    np.testing.assert_array_equal(mesh.faces, TRIANGLES)


def test_node_transforms_are_chained(tmp_path: Path) -> None:
    def move(d: dict) -> None:
        quarter_turn_about_z = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]
        d["nodes"] = [
            {"children": [1], "translation": [10, 0, 0]},
            {"mesh": 0, "rotation": quarter_turn_about_z, "scale": [2, 1, 1]},
        ]

    mesh = read_changed(tmp_path, move)

    # Scale first, then turn, then move: (1, 0, 0) becomes (2, 0, 0), (0, 2, 0), (10, 2, 0).
    np.testing.assert_allclose(
        mesh.vertices, [[10, 0, 0], [10, 2, 0], [9, 0, 0], [10, 0, 1]], atol=1e-6
    )


def test_a_matrix_is_stored_by_columns(tmp_path: Path) -> None:
    matrix = np.eye(4)
    matrix[:3, 3] = [1, 2, 3]

    mesh = read_changed(tmp_path, lambda d: d["nodes"][0].update(matrix=matrix.T.ravel().tolist()))

    np.testing.assert_allclose(mesh.vertices[0], [1, 2, 3])


def test_a_mirrored_node_stays_right_side_out(tmp_path: Path) -> None:
    mesh = read_changed(tmp_path, lambda d: d["nodes"][0].update(scale=[-1, 1, 1]))

    assert mesh.signed_volume == pytest.approx(1 / 6)
    assert mesh.bounds[0].tolist() == [-1, 0, 0]


def test_one_mesh_at_two_nodes_is_two_pieces(tmp_path: Path) -> None:
    def twice(d: dict) -> None:
        d["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}]
        d["scenes"] = [{"nodes": [0, 1]}]

    mesh = read_changed(tmp_path, twice)

    assert (len(mesh.vertices), len(mesh.faces)) == (8, 8)
    assert mesh.signed_volume == pytest.approx(2 / 6)


def test_one_mesh_at_any_number_of_nodes_has_an_end(tmp_path: Path, monkeypatch) -> None:
    """Each node repeats the vertices, so that a small file could fill the memory."""
    monkeypatch.setattr(gltf, "_MOST_ELEMENTS", 50)

    def repeat(d: dict) -> None:
        d["nodes"] = [{"mesh": 0}] * 100
        d["scenes"][0]["nodes"] = list(range(100))

    with pytest.raises(DataError, match="more than 50 vertices and triangles"):
        read_changed(tmp_path, repeat)


def test_a_node_with_two_parents_is_refused(tmp_path: Path) -> None:
    def share(d: dict) -> None:
        d["nodes"] = [{"children": [1, 1]}, {"mesh": 0}]
        d["scenes"][0]["nodes"] = [0]

    with pytest.raises(DataError, match="node 1 is shared"):
        read_changed(tmp_path, share)


def test_only_the_default_scene_is_read(tmp_path: Path) -> None:
    def scenes(d: dict) -> None:
        d["scenes"] = [{"nodes": [0]}, {"nodes": [0]}]
        d["scene"] = 1

    assert len(read_changed(tmp_path, scenes).faces) == 4


def test_without_scenes_every_root_is_read_once(tmp_path: Path) -> None:
    def no_scene(d: dict) -> None:
        del d["scenes"], d["scene"]
        d["nodes"] = [{"mesh": 0}, {"children": [0], "translation": [1, 0, 0]}]

    mesh = read_changed(tmp_path, no_scene)

    assert len(mesh.faces) == 4
    assert mesh.bounds[0].tolist() == [1, 0, 0]


def test_without_indices_every_three_vertices_are_a_face(tmp_path: Path) -> None:
    corners = POINTS[TRIANGLES.ravel()]
    content = document()
    del content["meshes"][0]["primitives"][0]["indices"]
    content["accessors"][0]["count"] = 12
    content["bufferViews"][0] = {"buffer": 0, "byteLength": corners.nbytes}

    mesh = read(tmp_path, glb(content, corners.tobytes()))

    assert mesh.faces.tolist() == np.arange(12).reshape(4, 3).tolist()
    assert mesh.signed_volume == pytest.approx(1 / 6)


def test_lines_beside_the_surface_are_not_read(tmp_path: Path) -> None:
    mesh = read_changed(
        tmp_path,
        lambda d: d["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 1}),
    )

    assert len(mesh.vertices) == 4


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a GLB file"),
        (b"glTF", "not a GLB file"),
        (json.dumps(document()).encode(), "not a GLB file"),
        (glb(document())[:-4], "truncated or of another version .*expected glTF 2"),
        (glb(document()).replace(b"glTF\2", b"glTF\1"), "another version .*got glTF 1"),
        (glb(b"{not json"), "not a readable GLB .*JSONDecodeError"),
        (glb(b"\xff\xfe\xfd"), "not a readable GLB .*Error"),
        (glb(b"[]"), "not a readable GLB"),
        (glb(document(), INTERLEAVED), "not a readable GLB .*past the end of the file"),
        (glb({"asset": {"version": "2.0"}}), "has no triangles"),
    ],
)
def test_broken_files(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(tmp_path, content)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"]),
            "mesh.glb: needs KHR_draco_mesh_compression.*without compression",
        ),
        (lambda d: d["accessors"][0].update(sparse={}), "sparse accessors are not supported"),
        (lambda d: d["accessors"][0].pop("bufferView"), "sparse accessors are not supported"),
        (lambda d: d["buffers"][0].update(uri="mesh.bin"), "external buffers"),
        (lambda d: d["meshes"][0]["primitives"][0].update(mode=5), "strips and fans"),
        (lambda d: d["meshes"][0]["primitives"][0].update(mode=1), "has no triangles"),
        (lambda d: d["accessors"][0].update(count=5), "past the end of the file"),
        (lambda d: d["accessors"][1].update(count=10), "not a readable GLB .*reshape"),
        (lambda d: d["accessors"][1].update(componentType=1), "not a readable GLB .*KeyError"),
        (lambda d: d["accessors"][0].update(count=3), "not a readable GLB .*vertex 3 of 3"),
        (lambda d: d["nodes"][0].update(mesh=1), "not a readable GLB .*IndexError"),
        (lambda d: d["nodes"][0].update(children=[0]), "a node that is its own ancestor"),
        (lambda d: d["nodes"][0].update(children=["0"]), "not a readable GLB .*TypeError"),
        (lambda d: d["nodes"][0].update(rotation=[0, 0, 1]), "not a readable GLB .*ValueError"),
        (lambda d: d["nodes"][0].update(rotation=[0, 0, 0, 0]), "mesh.glb: not a quaternion"),
        (lambda d: d["nodes"][0].update(matrix=[1, 0]), "not a readable GLB .*reshape"),
        (lambda d: d["nodes"][0].update(scale=[0, 0, 0]), "no measurable surface"),
        (lambda d: d["nodes"][0].update(translation=[float("nan"), 0, 0]), "non-finite vertices"),
    ],
)
def test_broken_documents(tmp_path: Path, change: Callable[[dict], object], message: str) -> None:
    with pytest.raises(DataError, match=message):
        read_changed(tmp_path, change)
