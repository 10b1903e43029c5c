"""Distances to the edges of a surface: a mistake of published evaluators that is in their numbers.

Their search takes faces below an area for degenerate and measures to the nearest of their edges.
The area was meant for another unit, and every face of a person is below it. A perfect copy then
scores a third of the inradius of its faces, on average over their area.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.geometry.surface import SurfaceIndex, raycasting_scene, search_nearest


class EdgeIndex:
    """The edges of all faces of a surface, and the faces that are large enough to count whole.

    Args:
        surface: In metres.
        below_m2: Faces of at least this area count whole.
    """

    def __init__(self, surface: SurfaceIndex, below_m2: float) -> None:
        mesh = surface.mesh
        ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
        keys = np.unique(ends[:, 0] * len(mesh.vertices) + ends[:, 1])
        first, second = np.divmod(keys, len(mesh.vertices))
        large = mesh.faces[surface.face_areas >= below_m2]
        # An edge is a triangle of which two corners are one: the search is exact on it.
        pieces = np.concatenate([np.stack([first, second, second], axis=1), large])
        self._mesh, self._pieces, self._centre = mesh, pieces, surface.centre
        self._scene: Any = raycasting_scene(mesh, self._centre, pieces)

    def distances(self, points: Floats) -> Floats:
        """(N,) metres from (N, 3) points to the nearest edge or large face."""
        pieces, barycentric = search_nearest(self._scene, points - self._centre)
        corners = self._mesh.vertices[self._pieces[pieces]]
        nearest = np.einsum("nk,nkc->nc", barycentric, corners)
        return np.sqrt(((points - nearest) ** 2).sum(axis=1))
