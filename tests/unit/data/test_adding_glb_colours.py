"""What a GLB says of its colours, and what becomes of it when it is added."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from harness.core.errors import DataError
from harness.data.converted_scans import (
    glb_painted,
    read_painted,
)
from tests.unit.data.test_adding_colours import PERSON, converted


def glb_of(path: Path, material: dict, *, colours=None, uv=None, **more) -> Path:
    """The person as a GLB with a material, in our own few lines; 0 is a picture of one colour."""
    picture = io.BytesIO()
    Image.new("RGB", (4, 4), (200, 30, 30)).save(picture, "PNG")
    corners = PERSON.vertices[PERSON.faces].reshape(-1, 3)
    arrays = {"POSITION": corners, "TEXCOORD_0": np.full((len(corners), 2), 0.5)}
    if uv is not None:
        arrays["TEXCOORD_0"] = uv
    if colours is not None:
        arrays["COLOR_0"] = np.broadcast_to(colours, (len(corners), 3))
    binary, views, accessors = b"", [], []
    for array in (*arrays.values(), picture.getvalue()):
        content = array if isinstance(array, bytes) else array.astype("<f4").tobytes()
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(content)})
        binary += content + b"\0" * (-len(content) % 4)
    for index, array in enumerate(arrays.values()):
        accessors.append({"bufferView": index, "componentType": 5126, "count": len(array)})
        accessors[-1]["type"] = f"VEC{array.shape[1]}"
    attributes = {name: index for index, name in enumerate(arrays)}
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "material": 0}]}],
        "materials": [material],
        "textures": [{"source": 0}],
        "images": [{"bufferView": len(arrays)}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    } | more
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary))
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    path.write_bytes(head + chunks + struct.pack("<II", len(binary), 0x004E4942) + binary)
    return path


def rough(**base) -> dict:
    return {"pbrMetallicRoughness": base}


def older(**base) -> dict:
    return {"extensions": {"KHR_materials_pbrSpecularGlossiness": base}}


TEXTURE = {"index": 0}


@pytest.mark.parametrize(
    ("material", "colours", "wanted"),
    [
        # sRGB of 0.2 is 124 and of 0.02 is 39; (200, 30, 30) by 0.2 is (95, 8, 8).
        (rough(baseColorFactor=[1, 0.1, 0.1, 1]), [0.2, 0.2, 0.2], (124, 39, 39)),
        (rough(baseColorFactor=[0.2, 0.2, 0.2, 1], baseColorTexture=TEXTURE), None, (95, 8, 8)),
        (rough(baseColorTexture=TEXTURE), [0.2, 0.2, 0.2], (95, 8, 8)),
        (rough(baseColorFactor=[0.4] * 4, baseColorTexture=TEXTURE), [0.5] * 3, (95, 8, 8)),
        (rough(baseColorTexture=TEXTURE), [1.0, 1.0, 1.0], (200, 30, 30)),
        (older(diffuseTexture=TEXTURE), None, (200, 30, 30)),
        (older(diffuseTexture=TEXTURE, diffuseFactor=[0.2] * 4), None, (95, 8, 8)),
        (older(diffuseFactor=[1, 0.1, 0.1, 1]), [0.2, 0.2, 0.2], (124, 39, 39)),
        (older(diffuseTexture=TEXTURE) | rough(baseColorFactor=[0, 0, 0, 1]), None, (200, 30, 30)),
    ],
)
def test_the_base_colour_of_a_glb_is_a_product(tmp_path, material, colours, wanted):
    painted = read_painted(glb_of(tmp_path / "p.glb", material, colours=colours))
    rows, columns = painted.pixels.shape[:2]
    assert painted.mesh.uv is not None
    x, y = (painted.mesh.uv[painted.mesh.face_uv] * (columns, rows)).reshape(-1, 2).T
    seen = painted.pixels[np.clip(rows - y, 0, rows - 1).astype(int), x.astype(int)]
    assert np.abs(seen.astype(int) - wanted).max() <= 1


def test_faces_may_tint_a_texture_each_in_its_colour(tmp_path):
    tints = np.repeat(np.where(np.arange(len(PERSON.faces)) % 2, 1.0, 0.2), 3)[:, None]
    material = rough(baseColorTexture=TEXTURE)
    path = glb_of(tmp_path / "p.glb", material, colours=np.repeat(tints, 3, axis=1))
    mesh, pixels = converted(path, tmp_path / "p1")
    colours = {tuple(texel) for texel in pixels.reshape(-1, 3).tolist()}
    assert {(200, 30, 30), (95, 9, 9)} <= colours
    assert len(mesh.faces) == len(PERSON.faces)
    # One face between the two colours.
    tints[:3] = [[1.0], [0.2], [0.2]]
    glb_of(path, material, colours=np.repeat(tints, 3, axis=1))
    painted = read_painted(path)
    texels = painted.mesh.uv[painted.mesh.face_uv] * painted.pixels.shape[1::-1]
    ends = painted.pixels[
        painted.pixels.shape[0] - 1 - texels[..., 1].astype(int), texels[..., 0].astype(int)
    ]
    assert (200, 30, 30) in {tuple(texel) for texel in ends[-1].tolist()}
    assert (95, 9, 9) in {tuple(texel) for texel in ends[-1].tolist()}
    run = np.linspace(0, 1, len(tints))[:, None]
    with pytest.raises(DataError, match="run across the faces of a texture.*Bake"):
        read_painted(glb_of(tmp_path / "p.glb", material, colours=np.repeat(run, 3, axis=1)))


@pytest.mark.parametrize("mode", ["I;16", "P", "L", "RGBA"])
def test_pictures_of_any_kind_inside_a_glb(tmp_path, mode):
    stored = io.BytesIO()
    grey = np.full((8, 8), 30000, np.uint16)
    image = Image.fromarray(grey) if mode == "I;16" else Image.new("RGB", (8, 8), (117,) * 3)
    kinds = {"I;16": lambda: image, "P": lambda: image.quantize(4)}
    kinds.get(mode, lambda: image.convert(mode))().save(stored, "PNG")
    material = PBRMaterial(baseColorTexture=Image.new("RGB", (8, 8)))
    visual = TextureVisuals(uv=PERSON.uv, material=material)
    scan = trimesh.Trimesh(PERSON.vertices, PERSON.faces, visual=visual, process=False)
    content = scan.export(file_type="glb")
    size = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + size])
    binary = content[20 + size + 8 :] + stored.getvalue()
    document["bufferViews"].append(
        {
            "buffer": 0,
            "byteOffset": len(binary) - stored.tell(),
            "byteLength": stored.tell(),
        }
    )
    document["images"][0]["bufferView"] = len(document["bufferViews"]) - 1
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(binary), len(text), 0x4E4F534A)
    chunk = struct.pack("<II", len(binary), 0x004E4942)
    (tmp_path / "p.glb").write_bytes(head + text + chunk + binary)
    assert set(read_painted(tmp_path / "p.glb").pixels.ravel().tolist()) == {117}


@pytest.mark.parametrize("alpha", ["BLEND", "MASK"])
def test_transparency_is_told(tmp_path, alpha):
    material = rough(baseColorTexture=TEXTURE) | {"alphaMode": alpha}
    told: list[str] = []
    assert glb_painted(glb_of(tmp_path / "p.glb", material), told)
    assert told == [f"its materials of alpha {alpha} are opaque here"]


def test_light_of_its_own_is_told(tmp_path):
    material = rough(baseColorTexture=TEXTURE) | {"emissiveFactor": [0, 0.2, 0]}
    told: list[str] = []
    assert glb_painted(glb_of(tmp_path / "p.glb", material), told)
    assert told == ["light of its own materials (emissiveFactor) is left out of its colours"]
