"""A GLB in the form in which trimesh reads all of its colours.

trimesh 5 keeps vertex colours of 16 bits by their last eight bits alone. Under a name that the
format reserves for attributes of one's own, it hands over the values as they are.
"""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

from harness.core.errors import DataError
from harness.geometry.images import MOST_PIXELS

#: The attribute in which vertex colours arrive: linear light, floats or whole numbers.
COLOURS = "_HARNESS_COLOUR"
_HEAD = struct.Struct("<4sII")
_CHUNK = struct.Struct("<II")
_REPLACED, _FIRST_UV = "COLOR_0", 0
_TRANSFORM = "KHR_texture_transform"


def glb_for_trimesh(path: Path) -> io.BytesIO:
    """The file's bytes with vertex colours under the name ``COLOURS``.

    The file has been read by ``load_mesh``, so that its parts are known to be whole.

    Raises:
        DataError: textures that are placed in a way that the harness does not have.
    """
    content = path.read_bytes()
    magic, version, _ = _HEAD.unpack_from(content)
    size, kind = _CHUNK.unpack_from(content, _HEAD.size)
    start = _HEAD.size + _CHUNK.size
    document: dict[str, Any] = json.loads(content[start : start + size])
    _check_textures(path, document, content[start + size + _CHUNK.size :])
    for mesh in document.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            attributes = primitive["attributes"]
            if _REPLACED in attributes:
                attributes[COLOURS] = attributes.pop(_REPLACED)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = content[start + size :]
    total = start + len(text) + len(rest)
    head = _HEAD.pack(magic, version, total) + _CHUNK.pack(len(text), kind)
    return io.BytesIO(head + text + rest)


def _check_textures(path: Path, document: dict[str, Any], binary: bytes) -> None:
    """Refuse what trimesh leaves out or misreads without a word."""
    for material in document.get("materials", []):
        texture: dict[str, Any] = material.get("pbrMetallicRoughness", {}).get(
            "baseColorTexture", {}
        )
        other = texture.get("texCoord", _FIRST_UV) != _FIRST_UV
        if other or _TRANSFORM in texture.get("extensions", {}):
            raise DataError(
                f"{path} places a texture by {'other coordinates' if other else _TRANSFORM}",
                expected="the first texture coordinates as they are",
                hint="Export it again with one texture and one set of coordinates",
            )
        if texture:
            _check_picture(path, document, binary, texture["index"])


def _check_picture(path: Path, document: dict[str, Any], binary: bytes, index: int) -> None:
    from PIL import Image

    try:
        view = document["images"][document["textures"][index]["source"]]["bufferView"]
        place = document["bufferViews"][view]
        start = place.get("byteOffset", 0)
        with Image.open(io.BytesIO(binary[start : start + place["byteLength"]])) as picture:
            size = picture.size
            picture.load()
    # Pillow's decoders raise whatever a damaged picture leads them to.
    except Exception as error:
        raise DataError(
            f"the texture of {path} cannot be read",
            expected="PNG or JPEG inside the file",
            got=f"{type(error).__name__}: {error}",
            hint="Export it again with its textures inside, as PNG or JPEG",
        ) from error
    if size[0] * size[1] > MOST_PIXELS:
        raise DataError(
            f"the texture of {path} has too many pixels",
            expected=f"at most {MOST_PIXELS}",
            got=f"{size[0]} x {size[1]}",
        )
