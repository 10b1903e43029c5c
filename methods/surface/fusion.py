"""Open surfaces to one closed mesh: screened Poisson reconstruction, its largest piece, checked.

Source: Kazhdan and Hoppe, "Screened Poisson surface reconstruction", TOG 2013, as Open3D has it;
ECON and MExECON end in the same step (depth 10, largest component, 50 000 faces).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError, MethodError
from harness.core.mesh import Mesh
from harness.geometry.surface import vertex_normals
from harness.geometry.topology import concatenated, largest_piece, open_edges
from methods.surface.pinches import without_pinches

#: The octree's side over the longest side of what is fused, and levels more that it then needs for
#: cells of about the same size. The bulge in a wide gap can reach the octree's wall, where the
#: surface stays open, as at the published 1.1: then the next one is tried.
OCTREES = ((1.25, 0), (2.5, 1), (5.0, 2))


@dataclass(frozen=True, slots=True)
class FusionParameters:
    """How the surfaces are fused.

    Attributes:
        depth: Depth of the octree; its finest cell is 1.25 times the longest side, divided by
            2^depth.
        faces: Decimate to about this many faces; 0 keeps all.
    """

    depth: int = 9
    faces: int = 0

    def __post_init__(self) -> None:
        if not 4 <= self.depth <= 12 or self.faces < 0:
            raise DataError(
                "surfaces cannot be fused with these parameters",
                expected="depth 4 to 12, faces not negative",
                got=str(self),
            )


def fused(parts: Sequence[Mesh], parameters: FusionParameters | None = None) -> Mesh:
    """One closed, outward-facing piece through the vertices of all parts, world metres.

    Args:
        parts: Surfaces that face outwards, open or closed.
        parameters: None takes the defaults.

    Raises:
        MethodError: the result is not closed, not consistently oriented, or encloses nothing.
    """
    rules = parameters or FusionParameters()
    mesh = _bounded(concatenated(parts), rules.depth)
    if rules.faces and len(mesh.faces) > rules.faces:
        mesh = one_piece(_decimated(mesh, rules.faces))
    return _closed(mesh)


def one_piece(mesh: Mesh) -> Mesh:
    """The largest piece of a closed surface, cut apart where its folds touch."""
    # Twice: a crumb that hung on by a fin without thickness is a piece of its own without it.
    return largest_piece(without_pinches(largest_piece(mesh))[0])


def _bounded(cloud: Mesh, depth: int) -> Mesh:
    """One piece that does not reach the octree's wall, or the last that was tried."""
    mesh = cloud
    for margin, levels in OCTREES:
        mesh = one_piece(_poisson(cloud, depth + levels, margin))
        if not open_edges(mesh):
            break
    return mesh


def _poisson(cloud: Mesh, depth: int, margin: float) -> Mesh:
    import open3d as o3d

    normals = vertex_normals(cloud)
    oriented = np.linalg.norm(normals, axis=1) > 0.5
    # Centred, because the solver works in float32.
    centre = cloud.bounds.mean(axis=0)
    points: Any = o3d.geometry.PointCloud()
    points.points = o3d.utility.Vector3dVector(cloud.vertices[oriented] - centre)
    points.normals = o3d.utility.Vector3dVector(normals[oriented])
    # Threads add sums in any order; one thread gives equal output for equal input.
    surface, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        points, depth=depth, scale=margin, n_threads=1
    )
    return _from_open3d(surface, centre, "fused surface")


def _decimated(mesh: Mesh, faces: int) -> Mesh:
    import open3d as o3d

    given: Any = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices), o3d.utility.Vector3iVector(mesh.faces)
    )
    smaller = given.simplify_quadric_decimation(target_number_of_triangles=faces)
    return _from_open3d(smaller, np.zeros(3), mesh.source)


def _from_open3d(surface: Any, centre: Floats, source: str) -> Mesh:
    faces = np.asarray(surface.triangles)
    if len(faces) == 0:
        raise MethodError(f"the {source} is empty", expected="triangles", got="none")
    return Mesh(np.asarray(surface.vertices) + centre, faces, source=source)


def _closed(mesh: Mesh) -> Mesh:
    open_count = open_edges(mesh)
    if open_count:
        raise MethodError(
            "the fused surface is not closed",
            expected="every edge between two faces of the same orientation",
            got=f"{open_count} other edges among {len(mesh.faces)} faces",
            hint="Look at the sheets and the completion with --keep",
        )
    if mesh.signed_volume <= 0:
        raise MethodError(
            "the fused surface faces inwards",
            expected="a positive volume",
            got=f"{mesh.signed_volume:g} m3",
        )
    return mesh
