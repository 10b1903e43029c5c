"""How far each vertex of a mesh is from the truth, and how far its normal is turned: for pictures.

Means over vertices are no metric, since meshes have more vertices in some places than in others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.mesh import Mesh
from harness.geometry.surface import SurfaceIndex, vertex_normals
from metrics.distance import nearest_surface_mm
from metrics.normals import angles_deg


@dataclass(frozen=True, slots=True, eq=False)
class VertexErrors:
    """One number of each kind for every vertex.

    Attributes:
        distance_mm: (V,) to the nearest point of the true surface.
        normal_deg: (V,) between the vertex's normal and the smooth normal of that point; NaN where
            one of them does not exist, as at a vertex without faces.
    """

    distance_mm: Floats
    normal_deg: Floats


def vertex_errors(mesh: Mesh, truth: SurfaceIndex) -> VertexErrors:
    """The errors of every vertex of a mesh; both in metres, in one frame.

    Raises:
        DataError: a vertex that is absurdly far away.
    """
    nearest, distance_mm = nearest_surface_mm(mesh.vertices, truth)
    own, true = vertex_normals(mesh), truth.smooth_normals(nearest)
    has_normal = own.any(axis=1) & np.isfinite(true[:, 0])
    normal_deg = np.full(len(own), np.nan)
    normal_deg[has_normal] = angles_deg(own[has_normal], true[has_normal])
    return VertexErrors(distance_mm, normal_deg)
