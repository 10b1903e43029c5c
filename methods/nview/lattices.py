"""Closed surfaces on a lattice of points: which are enclosed, how deep, and back to a surface.

A surface that has run through itself is taken apart here. How often a point is enclosed is counted
with signs: where two sheets have crossed the count is 0 or less, which is outside; where two parts
overlap it is 2, which is inside as 1 is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints, Mask, Singles
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.geometry.surface import SurfaceIndex
from methods.nview.surfaces import Surface, smoothed_along
from methods.surface.fusion import largest_component

__all__ = [
    "Lattice",
    "contoured",
    "evened",
    "lattice_around",
    "remeshed",
    "signed_distance",
    "winding",
]

#: Lattice points beyond the box on each side.
_FREE_CELLS = 3
#: Part of a cell by which the lattice is shifted, so that its columns miss the vertices of earlier
#: surfaces and of anything modelled on round numbers.
_SHIFT = np.array([0.37, 0.41, 0.43])
#: Rays along columns start this far before the lattice, metres.
_BEFORE_M = 0.01
#: Rounds of smoothing along the surface after contouring, which leaves slivers.
_ROUNDS, _SHARE = 3, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Points at equal steps along three axes.

    Attributes:
        origin: (3,) the first point, world metres.
        step_m: Between neighbours.
        shape: Number of points along each axis.
    """

    origin: Floats
    step_m: float
    shape: tuple[int, int, int]

    def points(self, indices: Ints) -> Floats:
        """(N, 3) world metres of the points with indices (N, 3)."""
        return self.origin + self.step_m * indices

    def axis(self, number: int) -> Floats:
        """Coordinates along one axis, world metres."""
        return self.origin[number] + self.step_m * np.arange(self.shape[number])


def lattice_around(bounds: Floats, step_m: float) -> Lattice:
    """The lattice that holds a box (2, 3), world metres, with free points all round."""
    low, high = bounds
    counts = np.ceil((high - low) / step_m).astype(int) + 2 * _FREE_CELLS + 1
    x, y, z = (int(count) for count in counts)
    return Lattice(low + step_m * (_SHIFT - _FREE_CELLS), step_m, (x, y, z))


def winding(mesh: Mesh, lattice: Lattice) -> NDArray[np.int8]:
    """How often a closed mesh encloses each point of the lattice, with signs.

    Counted from the crossings along the lattice's columns; the median of three directions, because
    a ray in single precision may slip through an edge.
    """
    import open3d as o3d

    scene: Any = o3d.t.geometry.RaycastingScene()
    tensor: Any = o3d.core.Tensor
    centre = mesh.bounds.mean(axis=0)
    scene.add_triangles(
        tensor((mesh.vertices - centre).astype(np.float32)), tensor(mesh.faces.astype(np.uint32))
    )
    normals = mesh.face_normals()
    counts = [_counted(scene, lattice, centre, normals, axis) for axis in range(3)]
    first, second, third = counts
    return np.maximum(np.minimum(first, second), np.minimum(np.maximum(first, second), third))


def _counted(
    scene: Any, lattice: Lattice, centre: Floats, normals: Floats, axis: int
) -> NDArray[np.int8]:
    """The winding numbers along one axis, summed from its low end."""
    import open3d as o3d

    across = [other for other in range(3) if other != axis]
    first, second = np.meshgrid(*(lattice.axis(other) for other in across), indexing="ij")
    start_m = lattice.origin[axis] - _BEFORE_M
    rays = np.zeros((first.size, 6))
    rays[:, across[0]], rays[:, across[1]], rays[:, axis] = first.ravel(), second.ravel(), start_m
    rays[:, :3] -= centre
    rays[:, 3 + axis] = 1.0
    tensor: Any = o3d.core.Tensor
    answer = scene.list_intersections(tensor(rays.astype(np.float32)))
    column = answer["ray_ids"].numpy().astype(np.int64)
    face = answer["primitive_ids"].numpy().astype(np.int64)
    way_m = answer["t_hit"].numpy() - _BEFORE_M
    length = lattice.shape[axis]
    cell = np.clip(np.ceil(way_m / lattice.step_m).astype(np.int64), 0, length - 1)
    # Into the solid where the face looks back along the ray.
    entering = normals[face, axis] < 0
    sums = np.zeros((first.size, length), dtype=np.int8)
    np.add.at(sums, (column, cell), np.where(entering, 1, -1).astype(np.int8))
    np.cumsum(sums, axis=1, dtype=np.int8, out=sums)
    shape = (*(lattice.shape[other] for other in across), length)
    return np.moveaxis(sums.reshape(shape), 2, axis)


def signed_distance(mesh: Mesh, lattice: Lattice, reach_m: float) -> Singles:
    """Distance of each lattice point to a closed mesh, metres, positive inside.

    Exact within about ``reach_m`` of the surface, and clipped to it beyond.
    """
    inside = winding(mesh, lattice) > 0
    near = _border(inside, max(1, int(np.ceil(reach_m / lattice.step_m))))
    distance = np.where(inside, reach_m, -reach_m).astype(np.float32)
    indices = np.argwhere(near)
    if len(indices):
        way = SurfaceIndex(mesh).closest(lattice.points(indices))[1].clip(max=reach_m)
        distance[near] = np.where(inside[near], way, -way)
    return distance


def _border(inside: Mask, cells: int) -> Mask:
    """Points that have, within so many cells, both points inside and points outside."""
    from scipy.ndimage import maximum_filter, minimum_filter

    size = 2 * cells + 1
    grid = inside.astype(np.uint8)
    return np.asarray(maximum_filter(grid, size)) > np.asarray(minimum_filter(grid, size))


def contoured(lattice: Lattice, field: Singles, source: str) -> Mesh:
    """The largest piece of the surface where a field (positive inside) is zero, closed, outward.

    Raises:
        MethodError: the field is positive nowhere.
    """
    from skimage.measure import marching_cubes

    if not (field > 0).any():
        raise MethodError(
            f"the {source} is empty",
            expected="points that are inside the outlines of all views",
            got="none",
            hint="Check the cameras and the masks",
        )
    padded = np.pad(field, 1, constant_values=-lattice.step_m)
    vertices, faces, _, _ = marching_cubes(padded, level=0.0, spacing=(lattice.step_m,) * 3)
    world = vertices.astype(np.float64) + lattice.origin - lattice.step_m
    mesh = Mesh(world, faces, source=source)
    if mesh.signed_volume < 0:
        mesh = Mesh(world, faces[:, ::-1], source=source)
    return largest_component(mesh)


def remeshed(mesh: Mesh, step_m: float) -> Mesh:
    """The surface of what a closed mesh encloses, with edges of about ``step_m``: one piece."""
    lattice = lattice_around(mesh.bounds, step_m)
    # Beyond the next lattice point a distance is never interpolated.
    field = signed_distance(mesh, lattice, 1.8 * step_m)
    return evened(contoured(lattice, field, mesh.source))


def evened(mesh: Mesh) -> Mesh:
    """A contoured surface with its slivers spread out."""
    return smoothed_along(Surface(mesh), _ROUNDS, _SHARE).mesh
