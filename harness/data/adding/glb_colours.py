"""The colours of a GLB as one picture: factor by vertex colour by texture, in linear light."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.core.arrays import Bytes, Floats, Ints
from harness.core.errors import DataError
from harness.core.formats.gltf import GlbPart, read_glb_parts
from harness.core.mesh import Mesh
from harness.data.adding.atlas import Paint, joined, paint_of_corners
from harness.geometry.images import MOST_PIXELS, linear_from_srgb, load_rgb, srgb_from_linear

_PLAIN = "plain colours"
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
    shades = {bytes(paint.pixels[0, 0]) for *_, paint, source in pieces if source == _PLAIN}
    if all(source == _PLAIN for *_, source in pieces) and len(shades) < 2:
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
    return [(vertices, faces, paint, _PLAIN)]


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
