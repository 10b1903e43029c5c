"""Oriented points to one closed, outward piece: screened Poisson reconstruction.

Source: Kazhdan and Hoppe, "Screened Poisson surface reconstruction", TOG 2013, as Open3D has it.
The surface is closed everywhere, also where no point is: it bulges there, and a trim by the density
of the points takes such parts away again, which leaves it open. Which of the two serves a number
better depends on the number, so that both can be had.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.geometry.coinciding import largest_piece, open_edges
from harness.geometry.images import sampled
from harness.geometry.outline import Outline
from methods.points.cloud import OrientedPoints
from methods.points.filtering import MeshSettings
from methods.surface.fusion import OCTREES, one_piece

#: Vertices less far outside are left alone; and turns through all views.
_TOLERANCE_PX, _TURNS = 0.5, 8


def held_to(mesh: Mesh, outlines: Sequence[Outline]) -> Mesh:
    """The mesh without what lies outside the silhouettes; vertices inside all stay where they are.

    Args:
        mesh: World metres.
        outlines: Outlines of all views.
    """
    vertices = mesh.vertices.copy()
    for _ in range(_TURNS):
        moved = False
        for outline in outlines:
            outside, motion = _back_inside(vertices, outline)
            vertices[outside] += motion
            moved |= len(outside) > 0
        if not moved:
            break
    return replace(mesh, vertices=vertices)


def _back_inside(points: Floats, outline: Outline) -> tuple[Ints, Floats]:
    """Indices (M,) of the points outside a silhouette, and (M, 3) the way to its outline."""
    camera = outline.camera
    pixels, depth = camera.project(points)
    with np.errstate(invalid="ignore"):  # behind the camera: NaN, so not in the frame
        framed = ((pixels >= 0) & (pixels < camera.size)).all(axis=1)
    index = np.flatnonzero(framed)
    field = outline.distance_px
    distance = sampled(field, pixels[index]).astype(np.float64)
    index, distance = index[distance < -_TOLERANCE_PX], distance[distance < -_TOLERANCE_PX]
    down, across = np.gradient(field)
    at = pixels[index]
    slope = np.column_stack([sampled(across, at), sampled(down, at)]).astype(np.float64)
    slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-6)
    there = at - distance[:, None] * slope
    return index, camera.unproject(there, depth[index]) - points[index]


_LEAST_POINTS = 100


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """What the points became.

    Attributes:
        closed: Watertight, one piece, facing outwards.
        trimmed: Without the parts that have the fewest points; None where nothing is trimmed.
        margin: The octree's side over the longest side of the points.
    """

    closed: Mesh
    trimmed: Mesh | None
    margin: float

    @property
    def chosen(self) -> Mesh:
        """What the settings asked for."""
        return self.closed if self.trimmed is None else self.trimmed

    def details(self) -> dict[str, object]:
        """What a record says of it."""
        found: dict[str, object] = {
            "closed_faces": len(self.closed.faces),
            "octree_margin": self.margin,
        }
        if self.trimmed is not None:
            found["trimmed_faces"] = len(self.trimmed.faces)
            found["trimmed_area_share"] = round(1.0 - self.trimmed.area / self.closed.area, 4)
        return found


def meshed(
    points: OrientedPoints, settings: MeshSettings, outlines: Sequence[Outline] = ()
) -> Surfaces:
    """The surface through points, closed, and trimmed where that is asked for; world metres.

    Args:
        points: Oriented.
        settings: How.
        outlines: The silhouettes that it may be held to.

    Raises:
        MethodError: too few points, or a surface that is not closed or faces inwards.
    """
    thin = points.thinned(settings.cell_m)
    if len(thin) < _LEAST_POINTS:
        raise MethodError(
            "too few points for a surface",
            expected=f"at least {_LEAST_POINTS}",
            got=str(len(thin)),
            hint="Loosen the settings of 'keep'",
        )
    whole, density, margin = _closed_poisson(thin, settings.depth)
    if settings.silhouettes == "held":
        whole = held_to(whole, outlines)
    closed = one_piece(whole)
    if settings.trim == 0:
        return Surfaces(closed, None, margin)
    dense = density > np.quantile(density, settings.trim)
    kept = dense[whole.faces].all(axis=1)
    if not kept.any():
        raise MethodError("nothing is left of the surface", hint="Lower the setting 'mesh.trim'")
    return Surfaces(closed, largest_piece(whole.submesh(kept)), margin)


def _closed_poisson(points: OrientedPoints, depth: int) -> tuple[Mesh, Floats, float]:
    """The surface, (V,) its density of points, and the first margin that left it closed."""
    complaint = ""
    for margin, levels in OCTREES:
        whole, density = _poisson(points, depth + levels, margin)
        closed = one_piece(whole)
        loose, volume = open_edges(closed), closed.signed_volume
        if not loose and volume > 0:
            return whole, density, margin
        complaint = f"{loose} other edges among {len(closed.faces)} faces, {volume:g} m3"
    raise MethodError(
        "the surface of the points is not closed and outward",
        expected="every edge between two faces of one orientation, and a positive volume",
        got=complaint,
        hint="Look at the points with --keep",
    )


def _poisson(points: OrientedPoints, depth: int, margin: float) -> tuple[Mesh, Floats]:
    """The surface, and (V,) how dense the points are around each vertex."""
    import open3d as o3d

    # Centred, because the solver works in float32.
    centre = (points.positions.min(axis=0) + points.positions.max(axis=0)) / 2.0
    cloud: Any = o3d.geometry.PointCloud()
    cloud.points = o3d.utility.Vector3dVector(points.positions - centre)
    cloud.normals = o3d.utility.Vector3dVector(points.normals)
    # Threads add sums in any order; one thread gives equal output for equal input.
    surface, density = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=depth, scale=margin, n_threads=1
    )
    faces = np.asarray(surface.triangles)
    if len(faces) == 0:
        raise MethodError("the surface of the points is empty", expected="triangles", got="none")
    mesh = Mesh(np.asarray(surface.vertices) + centre, faces, source="surface of points")
    return mesh, np.asarray(density)
