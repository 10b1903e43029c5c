"""One texture for all layers: where each layer's square lies, and what is under each texel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from harness.data.avatars.anatomy import pattern_coordinates
from harness.data.avatars.layer import Layer
from harness.data.avatars.rays import RayScene
from harness.data.avatars.surface import Floats, Ints

__all__ = ["CELLS", "Texels", "cell_uv", "paint_atlas", "texels_of"]

CELLS: Mapping[str, tuple[float, float, float]] = {
    "head": (0.0, 0.0, 0.5),
    "top": (0.5, 0.0, 0.5),
    "bottom": (0.0, 0.5, 0.5),
    "skin": (0.5, 0.5, 0.25),
    "hair": (0.75, 0.5, 0.25),
    "shoes": (0.5, 0.75, 0.25),
    "eyes": (0.75, 0.75, 0.25),
}
"""Left, bottom and side of each layer's square in the texture, as shares of its width."""

_MARGIN = 0.004


@dataclass(frozen=True)
class Texels:
    """What is under a layer's texels: image rows and columns (N,), rest positions (N,3) and
    pattern places (N,2) in metres, texture coordinates (N,2) in the layer's own square.
    """

    rows: Ints
    columns: Ints
    rest: Floats
    pattern: Floats
    uv: Floats


def cell_uv(name: str, uv: Floats) -> Floats:
    """A layer's own texture coordinates (T,2) in [0,1] placed in the whole texture."""
    left, bottom, side = CELLS[name]
    return np.array([left, bottom]) + side * (_MARGIN + (1 - 2 * _MARGIN) * uv)


def texels_of(layer: Layer, size: int) -> Texels:
    """The texels that a layer's triangles cover in a texture of ``size`` pixels.

    Texels are found by casting a ray through each onto the flattened triangles, which is exact at
    triangle borders.
    """
    left, bottom, side = CELLS[layer.name]
    uv = cell_uv(layer.name, layer.uv)
    scene = RayScene(np.concatenate([uv, np.zeros((len(uv), 1))], 1), layer.uv_faces)
    columns = np.arange(round(left * size), round((left + side) * size))
    rows = np.arange(round((1 - bottom - side) * size), round((1 - bottom) * size))
    grid_columns, grid_rows = (a.ravel() for a in np.meshgrid(columns, rows))
    above = np.ones(len(grid_rows))
    origins = np.stack([(grid_columns + 0.5) / size, 1 - (grid_rows + 0.5) / size, above], 1)
    hit, face, shares = scene.first_hits(origins, np.array([0.0, 0.0, -1.0]))
    return Texels(
        rows=grid_rows[hit],
        columns=grid_columns[hit],
        rest=np.einsum("nk,nkd->nd", shares, layer.rest[layer.faces[face]]),
        pattern=pattern_coordinates(
            np.einsum("nk,nkd->nd", shares, layer.places[layer.faces[face]])
        ),
        uv=np.einsum("nk,nkd->nd", shares, layer.uv[layer.uv_faces[face]]),
    )


def paint_atlas(
    texels: Mapping[str, Texels], painters: Mapping[str, Callable[[Texels], Floats]], size: int
) -> np.ndarray:
    """The texture (size,size,3), 8-bit sRGB; an empty texel has the nearest painted one's colour.

    Without that, filtering at an island's border would mix in the background.
    """
    from scipy.ndimage import distance_transform_edt

    image = np.zeros((size, size, 3))
    painted = np.zeros((size, size), bool)
    for name, where in texels.items():
        image[where.rows, where.columns] = painters[name](where)
        painted[where.rows, where.columns] = True
    nearest = np.asarray(
        distance_transform_edt(~painted, return_distances=False, return_indices=True)
    )
    return np.clip(np.rint(image[tuple(nearest)]), 0, 255).astype(np.uint8)
