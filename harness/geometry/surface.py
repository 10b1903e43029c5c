"""A mesh as a surface: smooth normals, and the exact closest point of any query."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.mesh import Mesh

__all__ = ["SurfaceIndex", "SurfacePoints", "merged_positions", "vertex_normals"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: A sum of unit normals shorter than this has cancelled and no longer has a direction.
_CANCELLED = 1e-6
_LARGEST_COORDINATE = 1e15


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePoints:
    """Points on a mesh, with where on it they lie.

    Attributes:
        points: (N, 3) positions, in the mesh's unit and frame.
        faces: (N,) the face each point lies on.
        barycentric: (N, 3) weights of that face's three vertices, in their order; they sum to 1.
    """

    points: Floats
    faces: Indices
    barycentric: Floats

    def __len__(self) -> int:
        return len(self.points)


def merged_positions(vertices: Floats) -> Indices:
    """(V,) a number for each vertex that is equal where, and only where, positions are equal.

    Texture seams and face-by-face formats split vertices; by position they are one again.
    """
    x, y, z = vertices.T
    order = np.lexsort((z, y, x))
    is_new = np.zeros(len(vertices), dtype=np.int64)
    ordered = vertices[order]
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group = np.empty(len(vertices), dtype=np.int64)
    group[order] = np.cumsum(is_new)
    return group


def vertex_normals(mesh: Mesh) -> Floats:
    """(V, 3) unit normals, each the area-weighted mean over all faces that meet at the position.

    Faces that meet in space share a normal even where a texture seam splits their vertices. Where
    the faces cancel each other, as on both sides of a sheet without thickness, and at vertices
    without faces the normal is zero.
    """
    group = merged_positions(mesh.vertices)
    weighted = mesh.face_normals()
    corners = group[mesh.faces]
    count = int(group.max()) + 1
    sums = np.zeros((count, 3))
    total = np.zeros(count)
    areas = np.linalg.norm(weighted, axis=1)
    for corner in corners.T:
        total += np.bincount(corner, areas, count)
        for axis in range(3):
            sums[:, axis] += np.bincount(corner, weighted[:, axis], count)
    lengths = np.linalg.norm(sums, axis=1)
    kept = lengths > _CANCELLED * total
    sums /= np.where(kept, lengths, np.inf)[:, None]
    return sums[group]


class SurfaceIndex:
    """A mesh prepared for exact closest-point queries; build it once and ask it often.

    The search runs in float32 (Open3D on Embree), on coordinates from which the centre of the mesh
    was subtracted in float64, so that a far-away origin costs no precision: at the size of a person
    distances are right to 0.3 micrometres. Faces without area are left out.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.origin = mesh.bounds.mean(axis=0)
        self._searchable = np.flatnonzero(mesh.face_areas() > 0)
        self._scene = _raycasting_scene(mesh, self.origin, mesh.faces[self._searchable])

    @cached_property
    def vertex_normals(self) -> Floats:
        """(V, 3) see ``vertex_normals``."""
        return vertex_normals(self.mesh)

    def closest(self, points: Floats) -> tuple[SurfacePoints, Floats]:
        """The nearest points of the surface to (N, 3) query points, and their (N,) distances.

        Raises:
            DataError: a query point is not finite, or absurdly far away.
        """
        query = np.asarray(points, dtype=np.float64) - self.origin
        answer = self._scene.compute_closest_points(
            _tensor32(query, f"a point to measure against {self.mesh.source}")
        )
        faces = self._searchable[answer["primitive_ids"].numpy()]
        # Open3D's (u, v) weigh the second and the third vertex.
        second, third = answer["primitive_uvs"].numpy().astype(np.float64).T
        barycentric = np.stack([1.0 - second - third, second, third], axis=1)
        found = self.at(faces, barycentric)
        return found, np.linalg.norm(found.points - points, axis=1)

    def at(self, faces: Indices, barycentric: Floats) -> SurfacePoints:
        """The points with the given (N,) faces and (N, 3) barycentric weights."""
        points = _blend(self.mesh.vertices, self.mesh.faces[faces], barycentric)
        return SurfacePoints(points=points, faces=faces, barycentric=barycentric)

    def normals(self, where: SurfacePoints) -> Floats:
        """(N, 3) unit normals: vertex normals interpolated, face normals where these cancel."""
        blended = _blend(self.vertex_normals, self.mesh.faces[where.faces], where.barycentric)
        lengths = np.linalg.norm(blended, axis=1)
        cancelled = lengths < _CANCELLED
        if cancelled.any():
            a, b, c = self.mesh.vertices[self.mesh.faces[where.faces[cancelled]]].swapaxes(0, 1)
            blended[cancelled] = np.cross(b - a, c - a)
            lengths[cancelled] = np.linalg.norm(blended[cancelled], axis=1)
        return blended / lengths[:, None]


def _blend(values: Floats, corners: NDArray[np.int32], weights: Floats) -> Floats:
    """(N, 3) sums of the values at (N, 3) corners, weighted."""
    blended = values[corners[:, 0]] * weights[:, :1]
    for corner in (1, 2):
        blended += values[corners[:, corner]] * weights[:, corner : corner + 1]
    return blended


def _raycasting_scene(mesh: Mesh, origin: Floats, faces: NDArray[np.int32]) -> Any:
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        _tensor32(mesh.vertices - origin, f"a vertex of {mesh.source}"),
        _tensor(np.ascontiguousarray(faces, dtype=np.uint32)),
    )
    return scene


def _tensor32(coordinates: Floats, what: str) -> Any:
    """Coordinates as the search takes them: float32, and so small that their squares fit, too."""
    if not (np.abs(coordinates) < _LARGEST_COORDINATE).all():
        raise DataError(
            f"{what} is not finite", expected=f"coordinates below {_LARGEST_COORDINATE:g}"
        )
    return _tensor(np.ascontiguousarray(coordinates, dtype=np.float32))


def _tensor(array: Any) -> Any:
    """An Open3D tensor; typed loosely because its stubs know no numpy arrays."""
    import open3d as o3d

    return o3d.core.Tensor(array)  # pyright: ignore[reportCallIssue]
