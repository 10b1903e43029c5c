"""Closed surfaces on a lattice of points: which are enclosed, how deep, and back to a surface.

A surface that has run through itself is taken apart here. How often a point is enclosed is counted
with signs: where two sheets have crossed the count is 0 or less, which is outside; where two parts
overlap it is 2, which is inside as 1 is.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints, Mask, Singles
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.geometry.coinciding import largest_piece
from harness.geometry.outline import isosurface
from harness.geometry.place import place_of
from harness.geometry.surface import SurfaceIndex
from methods.closed.surfaces import SignedOutline, Surface, outlines_distance, smoothed_along

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
    crossings = _Crossings(mesh)
    first, second, third = (crossings.counted(lattice, axis) for axis in range(3))
    return np.maximum(np.minimum(first, second), np.minimum(np.maximum(first, second), third))


class _Crossings:
    """Where straight lines cross a mesh, and in which direction."""

    def __init__(self, mesh: Mesh) -> None:
        import open3d as o3d

        self._scene: Any = o3d.t.geometry.RaycastingScene()
        self._tensor: Any = o3d.core.Tensor
        self._bounds = mesh.bounds
        # Embree computes in single precision: the mesh is moved to the origin.
        self._centre = self._bounds.mean(axis=0)
        self._scene.add_triangles(
            self._tensor((mesh.vertices - self._centre).astype(np.float32)),
            self._tensor(mesh.faces.astype(np.uint32)),
        )
        self._normals = mesh.face_normals()

    def counted(self, lattice: Lattice, axis: int) -> NDArray[np.int8]:
        """The winding numbers of a lattice, summed along one axis from before the mesh."""
        across = [other for other in range(3) if other != axis]
        first, second = np.meshgrid(*(lattice.axis(other) for other in across), indexing="ij")
        start_m = min(self._bounds[0, axis], lattice.origin[axis]) - _BEFORE_M
        rays = np.zeros((first.size, 6))
        rays[:, across[0]], rays[:, across[1]] = first.ravel(), second.ravel()
        rays[:, axis] = start_m
        rays[:, :3] -= self._centre
        rays[:, 3 + axis] = 1.0
        answer = self._scene.list_intersections(self._tensor(rays.astype(np.float32)))
        way_m = answer["t_hit"].numpy() + (start_m - lattice.origin[axis])
        length = lattice.shape[axis]
        # One more cell holds what is crossed behind the lattice.
        cell = np.clip(np.ceil(way_m / lattice.step_m).astype(np.int64), 0, length)
        # Into the solid where the face looks back along the ray.
        entering = self._normals[answer["primitive_ids"].numpy().astype(np.int64), axis] < 0
        sums = np.zeros((first.size, length + 1), dtype=np.int8)
        column = answer["ray_ids"].numpy().astype(np.int64)
        np.add.at(sums, (column, cell), np.where(entering, 1, -1).astype(np.int8))
        np.cumsum(sums, axis=1, dtype=np.int8, out=sums)
        shape = (*(lattice.shape[other] for other in across), length + 1)
        return np.moveaxis(sums.reshape(shape)[..., :length], 2, axis)


def signed_distance(mesh: Mesh, lattice: Lattice, reach_m: float, cells: int = 0) -> Singles:
    """Distance of each lattice point to a closed mesh, metres, positive inside.

    Exact within about ``reach_m`` of the surface, and clipped to it beyond; with ``cells``, exact
    only so many cells from where the surface passes: contouring looks at one.
    """
    inside = winding(mesh, lattice) > 0
    near = _border(inside, cells or max(1, int(np.ceil(reach_m / lattice.step_m))))
    distance = np.where(inside, reach_m, -reach_m).astype(np.float32)
    indices = np.argwhere(near)
    if len(indices):
        way = SurfaceIndex(mesh).distance(lattice.points(indices)).clip(max=reach_m)
        distance[near] = np.where(inside[near], way, -way)
    return distance


def _border(inside: Mask, cells: int) -> Mask:
    """Points that have, within so many cells, both points inside and points outside."""
    from scipy.ndimage import maximum_filter, minimum_filter

    size = 2 * cells + 1
    grid = inside.astype(np.uint8)
    return np.asarray(maximum_filter(grid, size)) > np.asarray(minimum_filter(grid, size))


def way_to_others(chosen: Mask, step_m: float) -> Singles:
    """(X, Y, Z) distance of each chosen lattice point to the nearest other one, metres.

    It is 0 at the others. Worked out plane by plane: SciPy's own distances take 60 bytes a point,
    which is half a gigabyte around a person.

    Args:
        chosen: (X, Y, Z); at least one is not.
        step_m: Between points.
    """
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(chosen, return_distances=False, return_indices=True)
    way_m = np.empty(chosen.shape, dtype=np.float32)
    second, third = np.ogrid[: chosen.shape[1], : chosen.shape[2]]
    for first, plane in enumerate(np.moveaxis(np.asarray(nearest), 1, 0)):
        squared = (plane[0] - first) ** 2 + (plane[1] - second) ** 2 + (plane[2] - third) ** 2
        way_m[first] = np.sqrt(squared) * step_m
    return way_m


def contoured(lattice: Lattice, field: Singles, source: str) -> Mesh:
    """The largest piece of the surface where a field (positive inside) is zero, closed, outward.

    Raises:
        MethodError: the field is positive nowhere.
    """
    if not (field > 0).any():
        raise MethodError(
            f"the {source} is empty",
            expected="points that are inside the outlines of all views",
            got="none",
            hint="Check the cameras and the masks",
        )
    step_m = lattice.step_m
    return largest_piece(
        isosurface(field, outside=-step_m, origin=lattice.origin, step=step_m, source=source)
    )


def remeshed(mesh: Mesh, step_m: float, within: Callable[[Floats], Singles] | None = None) -> Mesh:
    """The surface of what a closed mesh encloses, with edges of about ``step_m``: one piece.

    Args:
        mesh: May run through itself.
        step_m: Spacing of the lattice, metres.
        within: Signed distance of world points (N, 3) to a region, positive inside; what reaches
            beyond that region near the surface is cut off.
    """
    lattice = lattice_around(mesh.bounds, step_m)
    # Beyond the next lattice point a distance is never interpolated.
    reach_m = np.float32(1.8 * step_m)
    field = signed_distance(mesh, lattice, float(reach_m), 1 if within is None else 0)
    if within is not None:
        near = np.abs(field) < reach_m
        points = lattice.points(np.argwhere(near))
        field[near] = np.minimum(field[near], within(points))
    return evened(contoured(lattice, field, mesh.source))


def evened(mesh: Mesh) -> Mesh:
    """A contoured surface with its slivers spread out."""
    return smoothed_along(Surface(mesh), _ROUNDS, _SHARE).mesh


#: Lattice points that are asked at once, which bounds the memory.
_AT_ONCE = 500_000


def cut_to_outlines(mesh: Mesh, outlines: Sequence[SignedOutline], step_m: float) -> Mesh:
    """The part of what a closed mesh encloses that every outline shows: its largest piece, closed.

    Unlike ``remeshed``, which looks near the surface only, this cuts bulges of any size.

    Args:
        mesh: World metres; it may run through itself.
        outlines: The subject's, in as many photos as there are.
        step_m: Spacing of the lattice on which the surface is made anew, metres.

    Raises:
        MethodError: no part of the mesh is inside all outlines.
    """
    lattice = lattice_around(mesh.bounds, step_m)
    # Beyond the next lattice point a distance is never interpolated.
    field = signed_distance(mesh, lattice, 1.8 * step_m)
    inside = np.argwhere(field > -step_m)
    for first in range(0, len(inside), _AT_ONCE):
        indices = inside[first : first + _AT_ONCE]
        place = tuple(indices.T)
        field[place] = np.minimum(
            field[place], outlines_distance(outlines, lattice.points(indices))
        )
    return evened(contoured(lattice, field, mesh.source))


#: Lattice points along the edge of a block; the outlines are asked for a block's middle first.
_BLOCK = 4
#: Points of the search for the subject's box, metres apart, and free space around what the
#: silhouettes span; seen from few sides a subject may be deeper than it is wide.
_SEARCH_STEP_M, _SEARCH_MARGIN_M, _WIDEST = 0.04, 0.1, 1.5
#: A distance to a cone changes by at most about the distance moved; the rest is for the change of
#: depth and for the pixel grid.
_CAUTION = 1.2


def hull_lattice(outlines: Sequence[SignedOutline], step_m: float) -> Lattice:
    """The lattice around all that is inside all outlines.

    Raises:
        MethodError: nothing is.
    """
    place = place_of([outline.plain for outline in outlines])
    half = _WIDEST * max(place.half_width_m, place.half_height_m) + _SEARCH_MARGIN_M
    count = int(np.ceil(2 * half / _SEARCH_STEP_M)) + 1
    search = Lattice(place.centre - half, _SEARCH_STEP_M, (count, count, count))
    points = search.points(_indices(search.shape))
    reach_m = _CAUTION * _SEARCH_STEP_M * np.sqrt(3) / 2
    found = points[outlines_distance(outlines, points) > -reach_m]
    if not len(found):
        raise MethodError(
            "the outlines have no common volume",
            expected="silhouettes of one subject, from the cameras given",
            got="no point that all views see inside",
            hint="Check the cameras and the masks",
        )
    return lattice_around(
        np.stack([found.min(axis=0) - reach_m, found.max(axis=0) + reach_m]), step_m
    )


def hull_field(outlines: Sequence[SignedOutline], lattice: Lattice) -> Singles:
    """The hull's distance at each lattice point, positive inside; exact near its surface.

    Some points away from the surface, a block of points has the distance of its middle.
    """
    x, y, z = lattice.shape
    blocks = (-(-x // _BLOCK), -(-y // _BLOCK), -(-z // _BLOCK))
    half_m = (_BLOCK - 1) / 2 * lattice.step_m
    middles = lattice.points(_BLOCK * _indices(blocks)) + half_m
    coarse = outlines_distance(outlines, middles).reshape(blocks)
    field = coarse
    for axis in range(3):
        field = np.repeat(field, _BLOCK, axis=axis)
    near_m = _CAUTION * _BLOCK * lattice.step_m * np.sqrt(3) / 2 + lattice.step_m
    inside = _indices((_BLOCK, _BLOCK, _BLOCK))
    active = np.argwhere(np.abs(coarse) <= near_m)
    for chunk in np.array_split(active, max(1, len(active) // 4000)):
        indices = (_BLOCK * chunk[:, None, :] + inside[None]).reshape(-1, 3)
        field[tuple(indices.T)] = outlines_distance(outlines, lattice.points(indices))
    return field[:x, :y, :z]


def _indices(shape: tuple[int, int, int]) -> Ints:
    """(N, 3) of all points of a lattice, the last axis running fastest."""
    return np.indices(shape).reshape(3, -1).T
