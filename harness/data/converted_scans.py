"""A scan becomes the files that the harness reads: upright, one OBJ, one material, one picture."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import AnyInts, Bytes, Floats, Ints, Mask
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_directory, read_json, write_json
from harness.core.files.hashing import file_sha256
from harness.core.files.npz import write_npz
from harness.core.files.pickles import read_array_pickle
from harness.core.mesh import Mesh
from harness.data.layouts import Companions, named_files, ply_pictures
from harness.data.scans import ADDED, stature
from harness.data.texture_atlas import Paint, joined, paint_of_corners
from harness.files.coloured_mesh import FileColours
from harness.files.gltf import GlbPart, read_glb_parts
from harness.files.mesh_files import atlas_of, load_mesh, read_pickled_mesh
from harness.files.mtl import Picture, materials_of
from harness.files.obj import read_obj_colours, write_obj
from harness.files.ply import read_ply_colours
from harness.geometry.images import (
    MOST_PIXELS,
    linear_from_srgb,
    load_rgb,
    save_png,
    srgb_from_linear,
)
from harness.geometry.occlusion import hidden_faces
from harness.geometry.surface import SurfaceIndex

_PLAIN_COLOUR = "plain colours"
#: As many colours of vertices may tint one texture, each face all over.
_MOST_TINTS, _ALIKE = 16, 1e-3
#: Of the faces of a texture, these many may lie along the borders of colours.
_MOST_RUNNING = 0.1
#: Vertices, faces, their colours, and where these come from, in words.
_Piece = tuple[Floats, Ints, Paint, str]


def glb_painted(path: Path, told: list[str]) -> tuple[Mesh, Paint, str] | None:
    """A GLB's surface, its colours, and where they come from, in words; None if it has no colours.

    Vertices at one place are one, as seams of textures split them. What is out of the ordinary is
    added to ``told``.

    Raises:
        DataError: as ``read_glb_parts``; a damaged picture, parts without colours beside others, or
            colours that run across the faces of a texture.
    """
    parts = read_glb_parts(path)
    pieces = [piece for part in parts if _has_colours(part) for piece in _pieces(part, path)]
    if any(part.shines for part in parts):
        told.append("light of its own materials (emissiveFactor) is left out of its colours")
    # One plain colour all over is how programs write a surface that has none.
    shades = {bytes(paint.pixels[0, 0]) for *_, paint, source in pieces if source == _PLAIN_COLOUR}
    if all(source == _PLAIN_COLOUR for *_, source in pieces) and len(shades) < 2:
        return None
    if lost := sum(not _has_colours(part) for part in parts):
        raise DataError(
            f"{lost} of {len(parts)} parts of {path} have no colours",
            hint="Remove what is not the person, or export it with one texture",
        )
    if alphas := sorted({part.alpha for part in parts} - {"OPAQUE"}):
        told.append(f"its materials of alpha {' and '.join(alphas)} are opaque here")
    paint = joined([paint for *_, paint, _ in pieces], str(path))
    starts = np.cumsum([0] + [len(vertices) for vertices, *_ in pieces[:-1]])
    faces = [faces + start for (_, faces, *_), start in zip(pieces, starts, strict=True)]
    vertices = np.concatenate([vertices for vertices, *_ in pieces])
    places, index = np.unique(vertices, axis=0, return_inverse=True)
    corners = index.reshape(-1)[np.concatenate(faces)]
    mesh = Mesh(places, corners, uv=paint.uv, face_uv=paint.face_uv, source=str(path))
    return mesh, paint, " and ".join(dict.fromkeys(source for *_, source in pieces))


def _has_colours(part: GlbPart) -> bool:
    return part.factor is not None or part.colours is not None


def _pieces(part: GlbPart, path: Path) -> list[_Piece]:
    """A part, or its faces by the colour that tints their texture."""
    factor = np.ones(3) if part.factor is None else part.factor
    vertices, faces = part.vertices, part.faces
    tints = None if part.colours is None else factor * part.colours[faces]
    if part.picture is not None and part.uv is not None:
        pixels = _decoded(part.picture, path)
        if tints is None:
            return [(vertices, faces, Paint(_tinted(pixels, factor), part.uv, faces), "texture")]
        runs = np.ptp(tints, axis=1).max(axis=1) > _ALIKE
        shades, which = np.unique(tints[:, 0].round(4), axis=0, return_inverse=True)
        which = np.where(runs, -1, which.reshape(-1))
        shown = np.unique(which[~runs])
        if runs.mean() > _MOST_RUNNING or len(shown) > _MOST_TINTS:
            raise DataError(
                f"{path} has vertex colours that run across the faces of a texture",
                expected=f"up to {_MOST_TINTS} colours, each all over its faces",
                hint="Bake them into the texture",
            )
        found: list[_Piece] = []
        for number in shown:
            tinted = faces[which == number]
            paint = Paint(_tinted(pixels, shades[number]), part.uv, tinted)
            found.append((vertices, tinted, paint, "texture"))
        if runs.any():
            # Along borders of colours, faces run from corner to corner.
            height, width = pixels.shape[:2]
            x, y = np.moveaxis(part.uv[faces[runs]], -1, 0)
            rows, columns = (1 - y) % 1 * height, x % 1 * width
            texels = pixels[rows.astype(int) % height, columns.astype(int) % width]
            corners = _srgb(linear_from_srgb(texels / 255.0) * tints[runs])
            found.append((vertices, faces[runs], paint_of_corners(corners), "texture"))
        return found
    if tints is not None:
        return [(vertices, faces, paint_of_corners(_srgb(tints)), "vertex colours")]
    plain = np.full((4, 4, 3), _srgb(factor), np.uint8)
    paint = Paint(plain, np.full((1, 2), 0.5), np.zeros_like(faces))
    return [(vertices, faces, paint, _PLAIN_COLOUR)]


def _srgb(linear: Floats) -> Bytes:
    return np.round(255 * srgb_from_linear(linear)).astype(np.uint8)


def _tinted(pixels: Bytes, tint: Floats) -> Bytes:
    """A texture (H, W, 3) times a colour (3,), in linear light."""
    if np.allclose(tint, 1.0, atol=1e-3):
        return pixels
    table = _srgb(linear_from_srgb(np.arange(256) / 255.0)[:, None] * tint)
    return np.stack([table[pixels[..., channel], channel] for channel in range(3)], axis=-1)


def _decoded(content: bytes, path: Path) -> Bytes:
    """(H, W, 3) sRGB of a picture inside the file."""
    try:
        return load_rgb(path, content)
    except DataError as error:
        raise DataError(
            f"the texture of {path} cannot be read",
            expected=f"PNG or JPEG inside the file, of up to {MOST_PIXELS} pixels",
            got=error.got,
            hint="Export it again with its textures inside, as PNG or JPEG",
        ) from error


_GREY = 160
_PLAIN = "plain colours"
#: What faces show: a picture, a plain colour, or nothing that the file defines.
_Look = Picture | tuple[float, float, float] | None


@dataclass(frozen=True, slots=True, eq=False)
class Painted:
    """A scan and its colours.

    Attributes:
        mesh: In the file's units and axes; ``texture`` is not set.
        pixels: (H, W, 3) uint8 sRGB.
        colours: Where they come from, in words.
        told: What is out of the ordinary, in words.
    """

    mesh: Mesh
    pixels: Bytes
    colours: str
    told: tuple[str, ...] = ()


def read_painted(path: Path, *folders: Path, grey: bool = False) -> Painted:
    """A scan with its colours as one picture.

    A texture counts before vertex colours, and these before a material's plain colour.

    Args:
        path: An OBJ, PLY or GLB file.
        folders: Where files that it names may lie, besides its own folder.
        grey: Whether a scan without colours is made grey, instead of refused.

    Raises:
        DataError: a defect of the file, a picture that is missing, or no colours.
    """
    suffix, told = path.suffix.lower(), list[str]()
    if suffix == ".pkl":
        surface, painted = _pickled(path)
        if painted:
            return painted
    else:
        # Every defect of the surface is found here, by the reader that finds them elsewhere.
        surface = load_mesh(path)
    if suffix == ".glb":
        if glb := glb_painted(path, told):
            mesh, paint, words = glb
            return Painted(mesh, paint.pixels, words, tuple(told))
    elif suffix != ".pkl":
        read = _obj_looks if suffix == ".obj" else _ply_looks
        colours, looks = read(path, folders, told)
        if painted := _painted(colours, looks, told):
            return painted
    if not grey:
        raise DataError(
            f"{path} has no colours: no texture, no vertex colours and no coloured material",
            got="; ".join(told),
            hint="Photos of it would show nothing on its surface, which methods need. Export it "
            "with its texture, or add it with --grey",
        )
    paint, _ = _plain(_GREY, surface.faces)
    mesh = replace(surface, uv=paint.uv, face_uv=paint.face_uv)
    return Painted(mesh, paint.pixels, "none: grey", tuple(told))


def _pickled(path: Path) -> tuple[Mesh, Painted | None]:
    """A pickled scan, and it with its texture, else with the colours of its vertices."""
    mesh, pixels, colours = read_pickled_mesh(path)
    if pixels is not None:
        return mesh, Painted(mesh, pixels, "texture")
    if colours is None:
        return mesh, None
    paint = paint_of_corners(colours[mesh.faces])
    painted = replace(mesh, uv=paint.uv, face_uv=paint.face_uv)
    told = (f"there is no texture {atlas_of(path).name}: the colours of its vertices are taken",)
    return mesh, Painted(painted, paint.pixels, "vertex colours", told)


def _obj_looks(
    path: Path, folders: tuple[Path, ...], told: list[str]
) -> tuple[FileColours, dict[int, _Look]]:
    """An OBJ's colours, and what each of its materials looks like, by number."""
    colours, materials = read_obj_colours(path), materials_of(path, *folders)
    numbers = {number: colours.names[number] for number in np.unique(colours.part).tolist()}
    looks: dict[str, _Look] = {}
    lost: list[str] = []
    for name in sorted(set(numbers.values())):
        material = materials.of(name)
        looks[name] = material and (material.picture(path, *folders) or material.colour)
        if name not in materials.defined and materials.files and (name or material is None):
            lost.append(f"'{name}'" if name else "faces before any usemtl")
    if lost:
        told.append(f"no material file defines {', '.join(lost)}")
    return colours, {number: looks[name] for number, name in numbers.items()}


def _ply_looks(
    path: Path, folders: tuple[Path, ...], told: list[str]
) -> tuple[FileColours, dict[int, _Look]]:
    """A PLY's colours, and the pictures of its ``TextureFile``s, by number."""
    colours, files = read_ply_colours(path), ply_pictures(path, *folders)
    numbers = np.unique(colours.part).tolist()
    if len(files) > 1 and numbers == [0]:
        told.append(
            f"all faces show the first of its {len(files)} pictures: no 'texnumber' names others"
        )
    if files and not all(0 <= number < len(files) for number in numbers):
        told.append(f"some faces show none of its {len(files)} pictures")
    return colours, {
        number: Picture(files[number]) if 0 <= number < len(files) else None for number in numbers
    }


def _painted(colours: FileColours, looks: Mapping[int, _Look], told: list[str]) -> Painted | None:
    """The surface with what its faces show as one picture; None if that is no colour at all."""
    mesh, parts = colours.mesh, dict[_Look, list[int]]()
    for number, look in looks.items():
        parts.setdefault(look, []).append(number)
    paints: list[Paint] = []
    faces: list[Ints] = []
    sources: list[str] = []
    for look, numbers in parts.items():
        faces.append(np.flatnonzero(np.isin(colours.part, numbers)))
        paint, source = _paint_of(colours, look, faces[-1])
        paints.append(paint)
        sources.append(source)
    if any(isinstance(look, Picture) for look in looks.values()) and mesh.uv is None:
        told.append("it names a picture, but has no texture coordinates")
    # One plain colour all over is how programs write a surface that has none.
    shades = {bytes(paint.pixels[0, 0]) for paint in paints}
    if set(sources) == {_PLAIN} and len(shades) == 1:
        return None
    if _PLAIN in sources and None in parts:
        told.append("faces of no colour are grey")
    paint = joined(paints, mesh.source)
    face_uv = np.empty_like(mesh.faces)
    face_uv[np.concatenate(faces)] = paint.face_uv
    # Pieces of a texture have vertices of their own in most PLY files, at the same places.
    places, index = mesh.vertices, np.arange(len(mesh.vertices))
    if mesh.source.lower().endswith(".ply"):
        places, index = np.unique(mesh.vertices, axis=0, return_inverse=True)
    one = Mesh(places, index.reshape(-1)[mesh.faces], paint.uv, face_uv, source=mesh.source)
    return Painted(one, paint.pixels, " and ".join(dict.fromkeys(sources)), tuple(told))


def _paint_of(colours: FileColours, look: _Look, chosen: Ints) -> tuple[Paint, str]:
    """What some faces show, and where it comes from, in words."""
    mesh = colours.mesh
    if isinstance(look, Picture) and mesh.uv is not None and mesh.face_uv is not None:
        pixels = load_rgb(look.path)
        uv = mesh.uv * look.scale + look.offset if look.is_placed else mesh.uv
        return Paint(pixels, uv, mesh.face_uv[chosen]), "texture"
    if colours.vertices is not None:
        return paint_of_corners(colours.vertices[mesh.faces[chosen]]), "vertex colours"
    if colours.faces is not None:
        corners = np.repeat(colours.faces[chosen][:, None], 3, axis=1)
        return paint_of_corners(corners), "face colours"
    colour = np.round(255 * np.array(look)) if isinstance(look, tuple) else _GREY
    return _plain(colour, mesh.faces[chosen])


def _plain(colour: Any, faces: AnyInts) -> tuple[Paint, str]:
    pixels = np.full((4, 4, 3), colour, np.uint8)
    return Paint(pixels, np.full((1, 2), 0.5), np.zeros_like(faces)), _PLAIN


#: Rows of the rotation that turns an axis of the file up, by quarter turns about X where they
#: do. +z is how Blender has it, whose -Y becomes +Z.
UPS: dict[str, Floats] = {
    "+y": np.eye(3),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "+z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "-z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "+x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "-x": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}
_MATERIAL, _PICTURE = "material0", "material0.png"
#: Grows when the same scan would become other files.
_VERSION = 2
_NONE = Companions()


@dataclass(frozen=True, slots=True)
class Conversion:
    """How scans are converted.

    Attributes:
        up: The axis of the file that points up, a key of ``UPS``.
        height_m: The height that each scan gets, metres; 0 where ``factor`` tells.
        factor: What coordinates are multiplied by.
        grey: Whether scans without colours are made grey.
        outer: Whether what no outside ray reaches is left out.
        folder: What the user named: a scan may name any file in it.
    """

    up: str
    height_m: float = 0.0
    factor: float = 1.0
    grey: bool = False
    outer: bool = False
    folder: Path | None = None

    @property
    def folders(self) -> tuple[Path, ...]:
        """Where files that a scan names may lie, besides its own folder."""
        return (self.folder,) if self.folder else ()

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            "up": self.up,
            "height_m": self.height_m,
            "factor": self.factor,
            "grey": self.grey,
            "outer": self.outer,
            "version": _VERSION,
        }


def is_converted(
    source: Path, conversion: Conversion, directory: Path, beside: Companions = _NONE
) -> bool:
    """Whether a folder holds a scan as ``convert_scan`` would write it now.

    Raises:
        DataError: the folder holds something else, or the scan names a file that is not there.
    """
    mark = directory / ADDED
    if not directory.exists():
        return False
    if not mark.is_file():
        raise DataError(
            f"{directory} is there and was not made by 'harness data add'",
            hint="Move it away, or choose another name for the dataset",
        )
    found = read_json(mark)
    whole = (directory / f"{directory.name}.obj", directory / _PICTURE)
    return (
        all(path.is_file() for path in whole)
        and found.get("conversion") == conversion.to_dict()
        and found.get("sha256") == _hashes(source, conversion, beside)
    )


def convert_scan(
    source: Path, conversion: Conversion, directory: Path, beside: Companions = _NONE
) -> None:
    """Write ``<id>.obj``, ``material0.mtl`` and ``material0.png`` into a folder named by the id.

    The body of its fit becomes ``body.npz``, labels ``labels.npz``. The folder appears when all of
    it is there.

    Raises:
        DataError: a scan that cannot be read, or without colours; a full disk.
    """
    hashes = _hashes(source, conversion, beside)
    painted = read_painted(source, *conversion.folders, grey=conversion.grey)
    kept = _kept(painted.mesh, conversion, beside)
    mesh, to_metres = _placed(
        painted.mesh if kept.all() else painted.mesh.submesh(kept), conversion
    )
    told, labels = list(painted.told), beside.files.get("labels")
    if not kept.all() and beside.floor is not None:
        told.append(f"what reaches below {beside.floor:g} of the file, its floor, is left out")
    truth = {"body": _body(beside, mesh, to_metres, told)}
    if labels is not None:
        truth["labels"] = _labels(labels, painted.mesh, kept, beside.regions)
    with atomic_directory(directory) as folder:
        write_obj(folder / f"{directory.name}.obj", mesh, material=_MATERIAL)
        material = f"newmtl {_MATERIAL}\nKd 1 1 1\nmap_Kd {_PICTURE}\n"
        (folder / f"{_MATERIAL}.mtl").write_text(material, encoding="ascii")
        save_png(folder / _PICTURE, painted.pixels)
        marks = {"conversion": conversion.to_dict(), "sha256": hashes, "colours": painted.colours,
                 "told": told}  # fmt: skip
        for name, arrays in truth.items():
            if arrays:
                write_npz(folder / f"{name}.npz", arrays)
        write_json(folder / ADDED, marks)


def told_of(directory: Path) -> tuple[str, ...]:
    """What was out of the ordinary when a scan was converted."""
    return tuple(read_json(directory / ADDED)["told"])


def _hashes(source: Path, conversion: Conversion, beside: Companions) -> dict[str, str]:
    """The scan's file, the materials and pictures that it names, and what belongs to it."""
    named = [*named_files(source, *conversion.folders), *beside.files.values()]
    return {os.path.relpath(path, source.parent): file_sha256(path) for path in (source, *named)}


def _kept(mesh: Mesh, conversion: Conversion, beside: Companions) -> Mask:
    """(F,) the faces of a scan that are the truth."""
    kept = ~hidden_faces(mesh) if conversion.outer else np.ones(len(mesh.faces), bool)
    if beside.floor is not None:
        heights = mesh.vertices @ UPS[conversion.up][1]
        kept &= (heights >= beside.floor)[mesh.faces].all(axis=1)
    return kept


def _placed(mesh: Mesh, conversion: Conversion) -> tuple[Mesh, Floats]:
    """The scan upright and in metres, and the (3, 3) matrix that makes it so."""
    turn = UPS[conversion.up]
    upright = replace(mesh, vertices=mesh.vertices @ turn.T)
    factor = conversion.factor
    if conversion.height_m:
        factor = conversion.height_m / float(stature(upright).extent[1])
    return replace(upright, vertices=upright.vertices * factor), turn * factor


#: A body is within a few centimetres of its clothes; one that is not belongs to another scan.
_MOST_OFF_M = 0.05


def _body(
    beside: Companions, mesh: Mesh, to_metres: Floats, told: list[str]
) -> dict[str, NDArray[Any]]:
    """The true body as the surface of the scan's fit; nothing where there is none."""
    path = beside.files.get("body")
    if path is None:
        return {}
    vertices = load_mesh(path).vertices @ to_metres.T
    _, distance = SurfaceIndex(mesh.geometry()).closest(vertices)
    if (off_m := float(distance.mean())) > _MOST_OFF_M:
        told.append(f"{path.name} is {1000 * off_m:.0f} mm off the scan on average, and is not "
                    "taken as its true body")  # fmt: skip
        return {}
    none = np.zeros((0, 3))
    return {"vertices": vertices, "joints": none, "joint_names": np.zeros(0, "U1")}


def _labels(
    path: Path, mesh: Mesh, kept: Mask, regions: tuple[str, ...]
) -> dict[str, NDArray[Any]]:
    """The regions of the faces that are kept: what most corners of each have."""
    found = read_array_pickle(path)
    numbers = next(iter(found.values()), np.zeros(0)).reshape(-1)
    if numbers.shape != (len(mesh.vertices),) or numbers.dtype.kind not in "iu":
        raise DataError(f"{path} holds no labels of the scan",
                        expected=f"{len(mesh.vertices)} whole numbers, one a vertex",
                        got=f"{numbers.shape} of {numbers.dtype}")  # fmt: skip
    if not 0 <= numbers.min() <= numbers.max() < len(regions):
        raise DataError(f"{path} has labels that are not known",
                        expected=f"0 to {len(regions) - 1}: {', '.join(regions)}",
                        got=f"{numbers.min()} to {numbers.max()}")  # fmt: skip
    corners = numbers[mesh.faces[kept]]
    most = np.where(corners[:, 1] == corners[:, 2], corners[:, 1], corners[:, 0])
    return {"face_labels": most.astype(np.int64), "names": np.array(regions)}
