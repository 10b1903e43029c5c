"""Binary glTF (GLB): the triangles that a viewer shows at rest, in the file's axes, coloured."""

import json
import re
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints
from harness.core.camera_frames import rotation_from_quaternion
from harness.core.errors import DataError
from harness.core.mesh import Mesh

Found = TypeVar("Found")

_KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_POINTS_AND_LINES, _TRIANGLES, _REPEAT = range(4), 4, 10497
#: Nodes may repeat one mesh many times, so a small file could expand to any number of vertices.
_MOST_ELEMENTS, _MOST_JSON_BYTES = 10_000_000, 16 * 2**20
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_SPECULAR, _TRANSFORM = "KHR_materials_pbrSpecularGlossiness", "KHR_texture_transform"
#: Extensions that change no shape, and one that is applied.
_READ = re.compile(
    r"(KHR|EXT)_(materials|texture|lights|xmp|audio|animation)\w*|MSFT_texture_dds|"
    r"FB_ngon_encoding|EXT_(mesh_features|structural_metadata)|KHR_mesh_quantization"
)
_SLACK = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class GlbPart:
    """The triangles of one primitive, and what their base colour is the product of.

    Attributes:
        vertices: (V, 3) in the file's axes, as posed and placed by its nodes.
        faces: (F, 3) vertex indices.
        factor: (3,) linear light; None without a material.
        colours: (V, 3) linear light, or None.
        picture: A PNG or JPEG, or None.
        uv: (V, 2) texture coordinates, origin at the bottom left, of the picture.
        alpha: ``OPAQUE``, ``MASK`` or ``BLEND``, as the material has it.
        shines: Whether the material has light of its own, which is not read.
    """

    vertices: Floats
    faces: Ints
    factor: Floats | None
    colours: Floats | None
    picture: bytes | None
    uv: Floats | None
    alpha: str
    shines: bool = False


@dataclass(frozen=True, slots=True)
class _Glb:
    document: dict[str, Any]
    binary: bytes


#: Vertices, faces and the primitive that they are of.
_Piece = tuple[Floats, Ints, dict[str, Any]]


def read_glb(path: Path) -> Mesh:
    """The geometry of a GLB file, all nodes of its scene joined, at rest; textures are not read.

    Nodes and the weights of morph targets are applied; animations are not played.

    Raises:
        DataError: not a GLB, truncated, compressed (Draco, meshopt), with triangle strips, a
            skin, or an extension that may change its shape.
    """
    pieces = _read(path, lambda glb: list(_pieces(glb)))
    offsets = np.cumsum([0] + [len(vertices) for vertices, *_ in pieces[:-1]])
    return Mesh(
        vertices=np.concatenate([vertices for vertices, *_ in pieces]),
        faces=np.concatenate(
            [faces + start for (_, faces, _), start in zip(pieces, offsets, strict=True)]
        ),
        source=str(path),
    )


def read_glb_parts(path: Path) -> list[GlbPart]:
    """The primitives of a GLB file with their base colours, in the order of ``read_glb``.

    Raises:
        DataError: as ``read_glb``; a picture outside the file, or placed in an unknown way.
    """
    return _read(path, lambda glb: [_part(glb, *piece) for piece in _pieces(glb)])


def _read(path: Path, use: Callable[[_Glb], list[Found]]) -> list[Found]:
    content = path.read_bytes()
    if content[:4] != b"glTF" or len(content) < 20:
        raise DataError(f"{path} is not a GLB file", expected="it to start with 'glTF'")
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2 or length > len(content):
        raise DataError(
            f"{path} is truncated or of another version",
            expected=f"glTF 2, {length} bytes",
            got=f"glTF {version}, {len(content)} bytes",
        )
    try:
        glb = _chunks(content[:length])
        _check_extensions(glb.document.get("extensionsRequired", []))
        # What overflows is no number, which is refused where it shows.
        with np.errstate(all="ignore"):
            found = use(glb)
    except DataError as error:
        raise error.located(path) from error
    except RecursionError as error:
        raise DataError(f"{path} has nodes nested too deep") from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise DataError(
            f"{path} is not a readable GLB", got=f"{type(error).__name__}: {error}"
        ) from error
    if not found:
        raise DataError(f"{path} has no triangles", expected="a mesh in its scene")
    return found


def _chunks(content: bytes) -> _Glb:
    document: dict[str, Any] = {}
    binary = b""
    position = 12
    while position + 8 <= len(content):
        size, kind = struct.unpack_from("<II", content, position)
        chunk = content[position + 8 : position + 8 + size]
        if kind == _JSON_CHUNK:
            if size > _MOST_JSON_BYTES:
                raise ValueError(f"a description of {size} bytes")
            document = json.loads(chunk)
        elif kind == _BINARY_CHUNK:
            binary = chunk
        position += 8 + size
    return _Glb(document, binary)


def _check_extensions(names: Iterable[str]) -> None:
    """Refuse what may change a shape and is not applied."""
    unknown = sorted(name for name in names if not _READ.fullmatch(name))
    if unknown:
        packed = any("compression" in name for name in unknown)
        raise DataError(
            f"needs {', '.join(unknown)}",
            hint=f"Export it again without {'compression' if packed else 'that'}",
        )


def _transforms(glb: _Glb) -> dict[int, Floats]:
    """Where each node of the default scene is, or of the whole file if it has no scene."""
    nodes: list[dict[str, Any]] = glb.document.get("nodes", [])
    if scenes := glb.document.get("scenes"):
        roots = scenes[glb.document.get("scene", 0)].get("nodes", [])
    else:
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [index for index in range(len(nodes)) if index not in children]
    found: dict[int, Floats] = {}
    left = [(index, np.eye(4)) for index in reversed(roots)]
    while left:
        index, parent = left.pop()
        if index in found:
            # The format gives a node one parent; shared nodes could grow without end.
            raise ValueError(f"node {index} is shared, or a node that is its own ancestor")
        node = nodes[index]
        _check_extensions(node.get("extensions", {}))
        found[index] = parent @ _node_transform(node)
        left += [(child, found[index]) for child in reversed(node.get("children", []))]
    return found


def _node_transform(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    transform = np.eye(4)
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    scale = np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    transform[:3, :3] = rotation_from_quaternion((w, x, y, z)) * scale
    transform[:3, 3] = node.get("translation", (0, 0, 0))
    return transform


def _pieces(glb: _Glb) -> Iterator[_Piece]:
    """The triangles of every primitive at every node, in the file's axes."""
    total = 0
    for index, transform in _transforms(glb).items():
        node = glb.document["nodes"][index]
        mesh: dict[str, Any] = glb.document["meshes"][node["mesh"]] if "mesh" in node else {}
        posed = ["a skin"] if mesh and "skin" in node else []
        _check_extensions([*mesh.get("extensions", {}), *posed])
        weights = node.get("weights") or mesh.get("weights")
        for primitive in mesh.get("primitives", []):
            mode = primitive.get("mode", _TRIANGLES)
            if mode in _POINTS_AND_LINES:
                continue
            if mode != _TRIANGLES:
                raise ValueError("triangle strips and fans are not supported")
            vertices, faces = _primitive(glb, primitive, weights)
            total += len(vertices) + len(faces)
            if total > _MOST_ELEMENTS:
                raise ValueError(f"more than {_MOST_ELEMENTS} vertices and triangles")
            # A mirrored node turns its triangles inside out.
            mirrored = np.linalg.det(transform[:3, :3]) < 0
            placed = vertices @ transform[:3, :3].T + transform[:3, 3]
            yield placed, faces[:, ::-1] if mirrored else faces, primitive


def _primitive(glb: _Glb, primitive: dict[str, Any], weights: Any) -> tuple[Floats, Ints]:
    _check_extensions(set(primitive.get("extensions", {})) - {"KHR_draco_mesh_compression"})
    vertices = _accessor(glb, primitive["attributes"]["POSITION"], 3).astype(np.float64)
    targets = primitive.get("targets", [])
    for target, weight in zip(targets, weights or [0.0] * len(targets), strict=True):
        if weight and "POSITION" in target:
            vertices = vertices + float(weight) * _accessor(glb, target["POSITION"], 3)
        if weight and any(name.startswith(("COLOR", "TEXCOORD")) for name in target):
            raise ValueError("morph targets that change colours are not supported")
    if "indices" in primitive:
        indices = _accessor(glb, primitive["indices"], 1)
        if indices.dtype.kind != "u":
            raise ValueError("indices that are not whole numbers")
        faces = indices.astype(np.int64).reshape(-1, 3)
    else:
        faces = np.arange(len(vertices)).reshape(-1, 3)
    if faces.size and int(faces.max()) >= len(vertices):
        raise IndexError(f"vertex {int(faces.max())} of {len(vertices)}")
    return vertices, faces


def _accessor(glb: _Glb, index: int, width: int = 0) -> NDArray[Any]:
    """(count, width) values; whole numbers that stand for parts of one are made such."""
    accessor = glb.document["accessors"][index]
    kind, number = np.dtype(_KINDS[accessor["componentType"]]), int(accessor["count"])
    found = _WIDTHS[accessor["type"]]
    if width and found != width:
        raise ValueError(f"an accessor of {accessor['type']} instead of {width} numbers")
    if "bufferView" in accessor:
        values = _values(glb, accessor, kind, number, found)
    elif "sparse" in accessor and 0 < number <= _MOST_ELEMENTS:
        values = np.zeros((number, found), kind)
    else:
        raise ValueError("an accessor has no data, as of a compressed mesh")
    if "sparse" in accessor:
        sparse = accessor["sparse"]
        where = np.dtype(_KINDS[sparse["indices"]["componentType"]])
        places = _values(glb, sparse["indices"], where, sparse["count"], 1)
        values = values.copy()
        values[places[:, 0]] = _values(glb, sparse["values"], kind, sparse["count"], found)
    if accessor.get("normalized") and kind.kind != "f":
        return np.maximum(values / np.iinfo(kind).max, -1.0)
    return values


def _values(
    glb: _Glb, place: dict[str, Any], kind: np.dtype[Any], number: int, width: int
) -> NDArray[Any]:
    """(number, width) values of a buffer."""
    view = glb.document["bufferViews"][place["bufferView"]]
    _check_extensions(view.get("extensions", {}))
    if view["buffer"] != 0 or glb.document["buffers"][0].get("uri"):
        raise ValueError("external buffers are not supported in a GLB")
    start, offset = view.get("byteOffset", 0), place.get("byteOffset", 0)
    stride = view.get("byteStride", 0) or kind.itemsize * width
    end = offset + stride * (number - 1) + kind.itemsize * width
    if number > 3 * _MOST_ELEMENTS or stride < kind.itemsize * width:
        raise ValueError(f"more than {_MOST_ELEMENTS} vertices and triangles, or some in one place")
    if number < 1 or end > view["byteLength"] or start + end > len(glb.binary):
        raise ValueError("an accessor reaches past the end of the file")
    strides = (stride, kind.itemsize)
    return np.ndarray((number, width), kind, glb.binary, start + offset, strides)


def _part(glb: _Glb, vertices: Floats, faces: Ints, primitive: dict[str, Any]) -> GlbPart:
    attributes = primitive["attributes"]
    colours = None
    if "COLOR_0" in attributes:
        given = _accessor(glb, attributes["COLOR_0"])[:, :3]
        whole = 1.0 if given.dtype.kind == "f" else np.iinfo(given.dtype).max
        colours = _checked(given / whole, (len(vertices), 3), "COLOR_0")
    if "material" not in primitive:
        return GlbPart(vertices, faces, None, colours, None, None, "OPAQUE")
    material = glb.document["materials"][primitive["material"]]
    base, kind = material.get("pbrMetallicRoughness", {}), "baseColor"
    if _SPECULAR in material.get("extensions", {}):
        base, kind = material["extensions"][_SPECULAR], "diffuse"
    factor = _checked(base.get(f"{kind}Factor", (1, 1, 1, 1))[:3], (3,), f"{kind}Factor")
    picture = uv = None
    if f"{kind}Texture" in base:
        picture, uv = _texture(glb, base[f"{kind}Texture"], attributes)
        if not np.isfinite(uv).all() or len(uv) != len(vertices):
            raise ValueError("not one finite place in the texture for each vertex")
    alpha = str(material.get("alphaMode", "OPAQUE"))
    shines = any(material.get("emissiveFactor", ()))
    return GlbPart(vertices, faces, factor, colours, picture, uv, alpha, shines)


def _checked(colours: Any, shape: tuple[int, ...], name: str) -> Floats:
    """Colours in linear light, from 0 to 1."""
    values = np.array(colours, dtype=np.float64)
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} is no colour, or not one for each vertex")
    return np.clip(values, 0.0, 1.0)


def _texture(glb: _Glb, info: dict[str, Any], attributes: dict[str, int]) -> tuple[bytes, Floats]:
    """A picture and the coordinates of vertices in it, from the bottom left."""
    texture = glb.document["textures"][info["index"]]
    image: dict[str, int] = {}
    if "source" in texture:
        image = glb.document["images"][texture["source"]]
    if "bufferView" not in image or _TRANSFORM in info.get("extensions", {}):
        raise DataError(
            "has a texture that is not read",
            expected="a PNG or JPEG inside the file, placed by its coordinates alone",
            got=", ".join([*texture.get("extensions", {}), *info.get("extensions", {})])
            or "a picture in another file",
            hint="Export it again in that way",
        )
    name = f"TEXCOORD_{info.get('texCoord', 0)}"
    uv = _accessor(glb, attributes[name], 2).astype(np.float64)
    sampler: dict[str, int] = {}
    if "sampler" in texture:
        sampler = glb.document["samplers"][texture["sampler"]]
    wraps = {sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT)}
    if wraps != {_REPEAT} and np.abs(uv - 0.5).max() > 0.5 + _SLACK:
        raise DataError("has coordinates outside of a texture that does not repeat")
    view = glb.document["bufferViews"][image["bufferView"]]
    content = _values(glb, image, np.dtype("u1"), view["byteLength"], 1)
    return content.tobytes(), np.column_stack([uv[:, 0], 1.0 - uv[:, 1]])
