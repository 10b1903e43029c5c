"""A scan in any of the accepted formats, with its colours as one picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.arrays import AnyInts, Bytes, Ints
from harness.core.errors import DataError
from harness.core.formats.coloured_mesh import FileColours
from harness.core.formats.mesh_files import load_mesh
from harness.core.formats.mtl import Picture, materials_of
from harness.core.formats.obj import read_obj_colours
from harness.core.formats.ply import read_ply_colours
from harness.core.mesh import Mesh
from harness.data.adding.atlas import Paint, joined, paint_of_corners
from harness.data.adding.glb_colours import glb_painted
from harness.data.adding.named_files import ply_pictures
from harness.geometry.images import load_rgb

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
    # Every defect of the surface is found here, by the reader that finds them elsewhere.
    surface = load_mesh(path)
    suffix, told = path.suffix.lower(), list[str]()
    if suffix == ".glb":
        if glb := glb_painted(path, told):
            mesh, paint, words = glb
            return Painted(mesh, paint.pixels, words, tuple(told))
    else:
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
