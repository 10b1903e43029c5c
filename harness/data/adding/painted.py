"""A scan in any of the accepted formats, with its colours as one picture.

OBJ files with one material are read by our own reader, all others by trimesh. What trimesh made of
a file is compared with what our strict reader made of it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.arrays import Bytes, Floats
from harness.core.errors import DataError
from harness.core.formats.mesh_files import load_mesh
from harness.core.formats.obj import read_obj_colours
from harness.core.mesh import Mesh
from harness.data.adding.atlas import Paint, joined, paint_of_corners
from harness.data.adding.glb_colours import glb_painted
from harness.data.adding.glb_files import COLOURS, glb_for_trimesh
from harness.data.adding.named_files import has_one_picture, maps_with_options, picture_files
from harness.geometry.images import check_picture, linear_from_srgb, load_rgb, srgb_from_linear

_GREY = 160
_PLAIN = "plain colours"
_PLY_WIDE = re.compile(rb"^property (?:u?short|u?int\d*|u?int16|double) red\s", re.MULTILINE)
_HEADER_BYTES = 65_536
#: Of the size of a scan: farther apart, two readers have read two things.
_SAME_PLACE, _SAME_AREA = 1e-4, 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Painted:
    """A scan and its colours.

    Attributes:
        mesh: In the file's units and axes; ``texture`` is not set.
        pixels: (H, W, 3) uint8 sRGB.
        colours: Where they come from, in words.
    """

    mesh: Mesh
    pixels: Bytes
    colours: str


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    vertices: Floats
    faces: Any
    paint: Paint
    colours: str


def read_painted(path: Path, *, grey: bool = False) -> Painted:
    """A scan with its colours as one picture.

    A texture counts before vertex colours, and these before a material's plain colour.

    Args:
        path: An OBJ, PLY or GLB file.
        grey: Whether a scan without colours is made grey, instead of refused.

    Raises:
        DataError: a defect of the file, a picture that is missing, or no colours.
    """
    # Every defect of the surface is found here, by the reader that finds them elsewhere.
    surface = load_mesh(path)
    if has_one_picture(path):
        mesh = load_mesh(path, texture=True)
        assert mesh.texture is not None
        return Painted(replace(mesh, texture=None), load_rgb(mesh.texture), "texture")
    _check_pictures(path)
    if path.suffix.lower() == ".glb" and (glb := glb_painted(path, [])):
        mesh, paint, words = glb
        return Painted(mesh, paint.pixels, words)
    if path.suffix.lower() == ".obj" and not picture_files(path):
        colours = read_obj_colours(path)
        if colours is not None:
            paint = paint_of_corners(colours[surface.faces])
            mesh = replace(surface, uv=paint.uv, face_uv=paint.face_uv)
            return Painted(mesh, paint.pixels, "vertex colours")
    pieces = [] if path.suffix.lower() == ".glb" else _pieces(path)
    if not pieces:
        if not grey:
            raise _colourless(path)
        uv, face_uv = np.full((1, 2), 0.5), np.zeros_like(surface.faces)
        plain = replace(surface, uv=uv, face_uv=face_uv)
        return Painted(plain, np.full((4, 4, 3), _GREY, np.uint8), "none: grey")
    mesh, paint = _whole(pieces, path)
    _check_same(surface, mesh)
    return Painted(mesh, paint.pixels, " and ".join(dict.fromkeys(p.colours for p in pieces)))


def _colourless(path: Path) -> DataError:
    return DataError(
        f"{path} has no colours: no texture, no vertex colours and no coloured material",
        hint="Photos of it would show nothing on its surface, which methods need. Export it with "
        "its texture, or add it with --grey",
    )


def _whole(pieces: Sequence[_Piece], path: Path) -> tuple[Mesh, Paint]:
    """All pieces as one mesh; vertices at one place are one, as seams of textures split them."""
    paint = joined([piece.paint for piece in pieces], str(path))
    offsets = np.cumsum([0] + [len(piece.vertices) for piece in pieces[:-1]])
    faces = np.concatenate([p.faces + start for p, start in zip(pieces, offsets, strict=True)])
    vertices = np.concatenate([piece.vertices for piece in pieces])
    places, index = np.unique(vertices, axis=0, return_inverse=True)
    mesh = Mesh(
        places, index.reshape(-1)[faces], uv=paint.uv, face_uv=paint.face_uv, source=str(path)
    )
    return mesh, paint


def _check_same(ours: Mesh, theirs: Mesh) -> None:
    size = float(ours.extent.max())
    moved = float(np.abs(ours.bounds - theirs.bounds).max())
    grown = abs(theirs.area - ours.area)
    if moved > _SAME_PLACE * size or grown > _SAME_AREA * ours.area:
        raise DataError(
            f"the surface and the colours of {ours.source} do not belong together",
            expected=f"one surface of area {ours.area:.6g}",
            got=f"another of area {theirs.area:.6g}, {moved:.3g} units away",
            hint="Export it again as OBJ with one material, or as PLY with vertex colours",
        )


def _check_pictures(path: Path) -> None:
    """Refuse what trimesh leaves out or misreads without a word."""
    with path.open("rb") as stream:
        head = stream.read(_HEADER_BYTES).split(b"end_header")[0]
    if path.suffix.lower() == ".ply" and _PLY_WIDE.search(head):
        raise DataError(
            f"{path} has vertex colours of another type than can be read",
            expected="uchar or float",
            hint="Export it with colours of 8 bits",
        )
    if lines := maps_with_options(path):
        raise DataError(
            f"the materials of {path} place their pictures by options",
            expected="map_Kd and the name of the picture",
            got=lines[0],
            hint="Bake its materials into one texture",
        )
    for picture in picture_files(path):
        try:
            check_picture(picture)
        except DataError as error:
            raise DataError(
                f"the texture of {path} is missing or damaged",
                got=error.what,
                hint="Copy the image next to the mesh, where the mesh or its material names it",
            ) from error


def _pieces(path: Path) -> list[_Piece]:
    """The parts of a scene, none if it has no colours.

    Raises:
        DataError: some parts have colours and others have not.
    """
    pieces = _read_pieces(path)
    coloured = [piece for piece in pieces if piece is not None]
    # One plain colour all over is how programs write a surface that has none.
    shades = {bytes(p.paint.pixels[0, 0]) for p in coloured if p.colours == _PLAIN}
    if all(piece.colours == _PLAIN for piece in coloured) and len(shades) < 2:
        return []
    if len(coloured) < len(pieces):
        raise DataError(
            f"{len(pieces) - len(coloured)} of {len(pieces)} parts of {path} have no colours",
            hint="Remove what is not the person, or export it with one texture",
        )
    return coloured


def _read_pieces(path: Path) -> list[_Piece | None]:
    """The parts of a scene as trimesh has them, in its axes; None for one without colours."""
    # Takes a third of a second, which listing and checking data need not wait for.
    import trimesh

    is_glb = path.suffix.lower() == ".glb"
    try:
        source = glb_for_trimesh(path) if is_glb else str(path)
        scene = trimesh.load_scene(source, file_type="glb" if is_glb else None, process=False)
        placed: list[tuple[Any, Any]] = []
        for node in scene.graph.nodes_geometry:
            matrix, name = scene.graph[node]
            placed.append((scene.geometry[name], matrix))
        return [
            _piece(geometry, np.asarray(matrix, np.float64), path)
            for geometry, matrix in placed
            if isinstance(geometry, trimesh.Trimesh)
        ]
    except DataError:
        raise
    except Exception as error:
        # Its readers raise whatever a file leads them to.
        raise DataError(
            f"the colours of {path} cannot be read", got=f"{type(error).__name__}: {error}"
        ) from error


def _piece(geometry: Any, matrix: Floats, path: Path) -> _Piece | None:
    paint, colours = _paint(geometry, path)
    if paint is None:
        return None
    vertices = np.asarray(geometry.vertices, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    faces = np.asarray(geometry.faces)
    if np.linalg.det(matrix[:3, :3]) < 0:
        # A mirrored node turns its triangles inside out.
        faces, paint = faces[:, ::-1], replace(paint, face_uv=paint.face_uv[:, ::-1])
    return _Piece(vertices, faces, paint, colours)


def _paint(geometry: Any, path: Path) -> tuple[Paint | None, str]:
    """The colours of one of trimesh's meshes, and where they come from."""
    faces = np.asarray(geometry.faces)
    visual: Any = geometry.visual
    material: Any = getattr(visual, "material", None)
    is_glb = path.suffix.lower() == ".glb"
    factor = getattr(material, "baseColorFactor", None) if is_glb else None
    picture: Any = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    uv: Any = getattr(visual, "uv", None)
    linear: Any = geometry.vertex_attributes.get(COLOURS)
    if picture is not None and uv is not None:
        pixels = _tinted(np.asarray(picture.convert("RGB")), factor)
        return Paint(pixels, np.asarray(uv, np.float64)[:, :2], faces), "texture"
    if linear is not None:
        return paint_of_corners(_srgb(np.asarray(linear))[faces]), "vertex colours"
    if visual.kind == "vertex":
        return paint_of_corners(np.asarray(visual.vertex_colors)[:, :3][faces]), "vertex colours"
    if visual.kind == "face":
        colours = np.asarray(visual.face_colors)[:, None, :3]
        return paint_of_corners(np.repeat(colours, 3, axis=1)), "face colours"
    if material is None:
        return None, ""
    white = np.full(3, 255, np.uint8)
    plain = _srgb(np.asarray(white if factor is None else factor)[None])[0]
    pixels = np.full((4, 4, 3), plain if is_glb else material.main_color[:3], np.uint8)
    return Paint(pixels, np.full((1, 2), 0.5), np.zeros_like(faces)), _PLAIN


def _srgb(linear: Any) -> Bytes:
    """(N, 3) uint8 sRGB of glTF's linear colours: floats, or whole numbers of any width."""
    values = linear[:, :3].astype(np.float64)
    if np.issubdtype(linear.dtype, np.integer):
        values /= np.iinfo(linear.dtype).max
    return np.round(255 * srgb_from_linear(np.clip(values, 0.0, 1.0))).astype(np.uint8)


def _tinted(pixels: Bytes, factor: Any) -> Bytes:
    """A texture times its material's factor, in linear light."""
    if factor is None:
        return pixels
    tint = linear_from_srgb(_srgb(np.asarray(factor)[None])[0] / 255.0)
    if np.allclose(tint, 1.0, atol=1e-3):
        return pixels
    linear = linear_from_srgb(np.arange(256) / 255.0)[:, None] * tint
    table = np.round(255 * srgb_from_linear(linear)).astype(np.uint8)
    return np.stack([table[pixels[..., channel], channel] for channel in range(3)], axis=-1)
