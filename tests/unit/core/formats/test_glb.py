"""GLB: small files made by hand, with moved nodes and interleaved buffers."""

from __future__ import annotations

import contextlib
import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.files import gltf
from harness.files.gltf import read_glb

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
        (lambda d: d["accessors"][0].update(sparse={}), "not a readable GLB .*KeyError"),
        (
            lambda d: d["accessors"][0].pop("bufferView"),
            "an accessor has no data, as of a compress",
        ),
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
        (lambda d: with_target(d, meshes=[0.0, 1.0]), "not a readable GLB .*ValueError: zip"),
        (lambda d: d["nodes"][0].update(matrix=[1, 0]), "not a readable GLB .*reshape"),
        (lambda d: d["nodes"][0].update(scale=[0, 0, 0]), "no measurable surface"),
        (lambda d: d["nodes"][0].update(translation=[float("nan"), 0, 0]), "non-finite vertices"),
    ],
)
def test_broken_documents(tmp_path: Path, change: Callable[[dict], object], message: str) -> None:
    with pytest.raises(DataError, match=message):
        read_changed(tmp_path, change)


def with_target(d: dict, **where: list[float]) -> None:
    """One morph target that lifts the last vertex by two, stored after the indices."""
    d["accessors"].append({"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC3"})
    d["bufferViews"].append({"buffer": 0, "byteOffset": 104, "byteLength": 48})
    d["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 2}]
    for name, weights in where.items():
        d[name][0]["weights"] = weights


LIFT = np.array([[0, 0, 0]] * 3 + [[0, 0, 2]], "<f4").tobytes()


@pytest.mark.parametrize(
    ("where", "height"),
    [
        ({"meshes": [0.5]}, 2.0),
        ({"nodes": [0.25]}, 1.5),
        ({"meshes": [1.0], "nodes": [-0.25]}, 0.5),
        ({"meshes": [1.0], "nodes": [0.0]}, 1.0),
        ({"meshes": [0.5], "nodes": []}, 2.0),
        ({}, 1.0),
    ],
)
def test_morph_targets_count_by_their_weights(tmp_path: Path, where: dict, height: float) -> None:
    changed = document()
    with_target(changed, **where)
    changed["nodes"][0]["scale"] = [1, 1, 10]
    mesh = read(tmp_path, glb(changed, BINARY + LIFT))
    np.testing.assert_allclose(mesh.vertices[3], [0, 0, 10 * height])
    np.testing.assert_array_equal(mesh.vertices[:3], POINTS[:3])


@pytest.mark.parametrize("based", [False, True])
def test_sparse_values_replace_others(tmp_path: Path, based: bool) -> None:
    changed = document()
    with_target(changed, meshes=[1.0])
    target = changed["accessors"][2]
    target["sparse"] = {
        "count": 1,
        "indices": {"bufferView": 3, "componentType": 5121},
        "values": {"bufferView": 2, "byteOffset": 36},
    }
    changed["bufferViews"].append({"buffer": 0, "byteOffset": 152, "byteLength": 1})
    if not based:
        del target["bufferView"]
    mesh = read(tmp_path, glb(changed, BINARY + LIFT + b"\1"))
    assert mesh.vertices[1].tolist() == [1, 0, 2]
    assert mesh.vertices[3].tolist() == [0, 0, 3 if based else 1]


@pytest.mark.parametrize(
    ("kind", "code", "normalized", "unit"),
    [("i1", 5120, True, 127), ("<u2", 5123, True, 65535), ("<i2", 5122, False, 1)],
)
def test_quantized_positions(tmp_path: Path, kind: str, code: int, normalized, unit: int) -> None:
    places = np.zeros((4, 4), kind)
    places[:, :3] = POINTS * unit
    changed = document()
    changed["extensionsRequired"] = ["KHR_mesh_quantization"]
    changed["accessors"][0] |= {"componentType": code, "normalized": normalized}
    size = places.nbytes
    changed["bufferViews"][0] = {"buffer": 0, "byteLength": size, "byteStride": size // 4}
    changed["bufferViews"][1]["byteOffset"] = size
    mesh = read(tmp_path, glb(changed, places.tobytes() + TRIANGLES.tobytes()))
    np.testing.assert_allclose(mesh.vertices, POINTS)


@pytest.mark.parametrize(
    "name",
    ["KHR_materials_unlit", "KHR_texture_basisu", "KHR_lights_punctual", "EXT_texture_webp"],
)
def test_extensions_that_change_no_shape_may_be_required(tmp_path: Path, name: str) -> None:
    mesh = read_changed(tmp_path, lambda d: d.update(extensionsRequired=[name]))
    np.testing.assert_array_equal(mesh.vertices, POINTS)
    mesh = read_changed(tmp_path, lambda d: d["nodes"][0].update(extensions={name: {}}))
    np.testing.assert_array_equal(mesh.faces, TRIANGLES)


def test_a_compressed_copy_beside_whole_data_is_not_needed(tmp_path: Path) -> None:
    draco = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    mesh = read_changed(
        tmp_path, lambda d: d["meshes"][0]["primitives"][0].update(extensions=draco)
    )
    np.testing.assert_array_equal(mesh.vertices, POINTS)


def node_extension(name: str) -> Callable[[dict], object]:
    return lambda d: d["nodes"][0].update(extensions={name: {}})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (node_extension("EXT_mesh_gpu_instancing"), "needs EXT_mesh_gpu_instancing"),
        (node_extension("VRMC_node_constraint"), "needs VRMC_node_constraint"),
        (node_extension("KHR_node_visibility"), "needs KHR_node_visibility"),
        (lambda d: d["meshes"][0].update(extensions={"A_b": {}}), "needs A_b.* without that"),
        (
            lambda d: d["meshes"][0]["primitives"][0].update(extensions={"A_b": {}}),
            "needs A_b.* without that",
        ),
        (
            lambda d: d["bufferViews"][0].update(extensions={"EXT_meshopt_compression": {}}),
            "needs EXT_meshopt_compression.* without compression",
        ),
        (
            lambda d: d.update(extensionsRequired=["KHR_materials_unlit", "EXT_x", "A_b"]),
            "needs A_b, EXT_x",
        ),
        (lambda d: d["nodes"][0].update(skin=0), "mesh.glb: needs a skin"),
        (lambda d: d["bufferViews"][0].update(buffer=1), "external buffers"),
        (lambda d: d["accessors"][1].update(type="VEC3", count=4), "an accessor of VEC3"),
        (
            lambda d: d["accessors"][1].update(componentType=5126, count=6),
            "indices that are not whole",
        ),
    ],
)
def test_what_may_change_the_shape_is_refused_by_name(tmp_path, change, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read_changed(tmp_path, change)


def part_of(folder: Path, material: dict | None, **more: list) -> gltf.GlbPart:
    """The part of a file with a material, and a texture after the indices."""
    changed = document()
    changed["accessors"].append({"bufferView": 2, "componentType": 5126, "count": 4})
    changed["accessors"][2]["type"] = "VEC2"
    changed["bufferViews"].append({"buffer": 0, "byteOffset": 12, "byteLength": 68})
    changed["bufferViews"][2]["byteStride"] = 20
    changed["bufferViews"].append({"buffer": 0, "byteOffset": 104, "byteLength": 7})
    primitive = changed["meshes"][0]["primitives"][0]
    primitive["attributes"]["TEXCOORD_0"] = 2
    if material is not None:
        changed["materials"], primitive["material"] = [material], 0
    changed["textures"], changed["images"] = [{"source": 0}], [{"bufferView": 3}]
    (folder / "mesh.glb").write_bytes(glb(changed | more, BINARY + b"picture"))
    (part,) = gltf.read_glb_parts(folder / "mesh.glb")
    return part


def test_a_material_and_its_picture(tmp_path: Path) -> None:
    base = {"baseColorFactor": [1, 0.5, 0.2, 0.7], "baseColorTexture": {"index": 0}}
    part = part_of(tmp_path, {"pbrMetallicRoughness": base, "alphaMode": "BLEND"})
    assert part.picture == b"picture"
    assert part.factor is not None
    assert part.factor.tolist() == [1, 0.5, 0.2]
    assert part.uv is not None
    # Sevens from the top are minus sixes from the bottom.
    assert part.uv.tolist() == [[7, -6]] * 4
    assert (part.alpha, part.colours) == ("BLEND", None)
    plain = part_of(tmp_path, None)
    assert (plain.factor, plain.picture, plain.alpha) == (None, None, "OPAQUE")


def test_the_diffuse_colour_of_an_older_material_counts(tmp_path: Path) -> None:
    older = {"diffuseFactor": [0.1, 0.2, 0.3, 1], "diffuseTexture": {"index": 0}}
    material = {
        "extensions": {"KHR_materials_pbrSpecularGlossiness": older},
        "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1]},
    }
    part = part_of(tmp_path, material)
    assert part.factor is not None
    assert part.factor.tolist() == [0.1, 0.2, 0.3]
    assert part.picture == b"picture"


@pytest.mark.parametrize(
    ("kind", "code", "white"), [("u1", 5121, 255), ("<u2", 5123, 65535), ("<f4", 5126, 1)]
)
@pytest.mark.parametrize("width", [3, 4])
def test_vertex_colours_are_linear_from_zero_to_one(tmp_path, kind, code, white, width) -> None:
    values = (np.eye(4)[:, :width] * white).astype(kind)
    changed = document()
    changed["accessors"].append({"bufferView": 2, "componentType": code, "count": 4})
    changed["accessors"][2]["type"] = f"VEC{width}"
    changed["bufferViews"].append({"buffer": 0, "byteOffset": 104, "byteLength": values.nbytes})
    changed["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2
    (tmp_path / "mesh.glb").write_bytes(glb(changed, BINARY + values.tobytes()))
    (part,) = gltf.read_glb_parts(tmp_path / "mesh.glb")
    np.testing.assert_array_equal(part.colours, np.eye(4)[:, :3])


@pytest.mark.parametrize(
    ("texture", "more", "message"),
    [
        ({"extensions": {"KHR_texture_transform": {}}}, {}, "texture that is not read .*transform"),
        ({"texCoord": 1}, {}, "not a readable GLB .*TEXCOORD_1"),
        ({}, {"images": [{"uri": "skin.png"}]}, "got a picture in another file"),
        ({}, {"textures": [{"extensions": {"EXT_texture_webp": {}}}]}, "got EXT_texture_webp"),
        (
            {},
            {"textures": [{"source": 0, "sampler": 0}], "samplers": [{"wrapT": 33071}]},
            "outside of a texture that does not repeat",
        ),
    ],
)
def test_textures_that_are_not_read(tmp_path: Path, texture: dict, more, message: str) -> None:
    base = {"baseColorTexture": {"index": 0, **texture}}
    with pytest.raises(DataError, match=message):
        part_of(tmp_path, {"pbrMetallicRoughness": base}, **more)
    # Its shape is read all the same.
    assert len(read_glb(tmp_path / "mesh.glb").faces) == 4


ODD = [None, -1, 0, 7, 1e308, float("nan"), 10**30, "x", [], {}, [[1]], [0] * 3, "VEC4", True]


def places(value: object, way: tuple = ()) -> list[tuple]:
    """The way to everything in a document."""
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    ways = [(*way, key) for key, _ in inner]
    below = value.values() if isinstance(value, dict) else value
    for key, each in zip([each[-1] for each in ways], below, strict=True):
        if isinstance(each, dict | list):
            ways += places(each, (*way, key))
    return ways


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("odd", ODD, ids=repr)
def test_a_document_with_an_odd_value_is_a_mesh_or_a_data_error(tmp_path: Path, odd) -> None:
    whole = document()
    with_target(whole, meshes=[0.5])
    whole["nodes"][0] |= {"translation": [0, 1, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
    attributes = whole["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"COLOR_0": 0, "TEXCOORD_0": 3}
    whole["meshes"][0]["primitives"][0]["material"] = 0
    whole["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC2"})
    base = {"baseColorFactor": [1, 1, 1, 1], "baseColorTexture": {"index": 0}}
    whole["materials"] = [{"pbrMetallicRoughness": base}]
    whole["textures"], whole["images"] = [{"source": 0}], [{"bufferView": 2}]
    for way in places(whole):
        changed = json.loads(json.dumps(whole))
        inside = changed
        for key in way[:-1]:
            inside = inside[key]
        inside[way[-1]] = odd
        (tmp_path / "mesh.glb").write_bytes(glb(changed, BINARY + LIFT))
        for use in (read_glb, gltf.read_glb_parts):
            with contextlib.suppress(DataError):
                assert use(tmp_path / "mesh.glb")
