"""Dents that a start surface has and the subject has not: filled where photos show cloth there.

A fused surface is dented between the legs of a skirt or a coat, and sometimes ends in a slit there:
normals mislead it. Photos could tell, but depths are only searched in pixels whose point of the
surface two views see, and the walls of a dent hide its floor from one of them. So the surface is
closed first, as if cloth spanned every hollow, and photos are asked around the closed one. A hollow
in front of which they agree on points is filled; armpits and the gap between legs are not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints, Ints32, Mask, Singles
from harness.core.mesh import Mesh
from harness.geometry.surface import SurfaceIndex
from methods.closed.lattices import (
    Lattice,
    contoured,
    evened,
    lattice_around,
    signed_distance,
    way_to_others,
)
from methods.photo_pull.pulled import StereoTask
from methods.stereo.pull import StereoPoints, joined
from methods.stereo.settings import DentSettings
from methods.stereo.surface import stereo_points
from methods.stereo.views import StereoView

#: Signed distances are exact within so many steps of the surface.
_EXACT_STEPS = 4
#: Beyond the closed solid by less than this many steps is the lattice's roughness and no hollow.
_ROUGH_STEPS = 0.5
#: A vertex that is nearer to the solid's surface than this, in steps, belongs to it.
_KEPT_STEPS = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Hollows:
    """The hollows of a solid on a lattice of points, numbered from 1.

    Attributes:
        surface: Of the solid.
        lattice: The points.
        depth_m: (X, Y, Z) signed distance to the solid's surface, positive inside, clipped.
        number: (X, Y, Z) of the hollow that a point lies in; 0 in none.
        count: How many hollows there are.
        outside_m: (X, Y, Z) distance to the solid; 0 in it.
        below_m: (X, Y, Z) distance to what is free after closing; 0 there.
    """

    surface: Mesh
    lattice: Lattice
    depth_m: Singles
    number: Ints32
    count: int
    outside_m: Singles
    below_m: Singles

    def volumes_m3(self) -> Floats:
        """(count,) of the hollows."""
        points = np.bincount(self.number.ravel(), minlength=self.count + 1)[1:]
        return points * self.lattice.step_m**3

    def filled(self, chosen: Mask) -> Mesh:
        """The surface of the solid with some of its hollows (count,) filled, closed, outward.

        Vertices beside the filled ones lie on the solid's own surface.
        """
        step_m = self.lattice.step_m
        added = np.concatenate([[False], chosen])[self.number]
        # Half a step: the surface is between the last point inside and the first outside.
        inside_m = way_to_others(added | (self.depth_m > 0), step_m) - np.float32(0.5 * step_m)
        most_m, least_m = _EXACT_STEPS * step_m, 0.25 * step_m
        field = np.where(added, np.clip(inside_m, least_m, most_m), self.depth_m)
        mesh = evened(contoured(self.lattice, field.astype(np.float32), "filled surface"))
        nearest, way_m = SurfaceIndex(self.surface).closest(mesh.vertices)
        kept = (way_m < _KEPT_STEPS * step_m)[:, None]
        return replace(mesh, vertices=np.where(kept, nearest.points, mesh.vertices))


def hollows_of(mesh: Mesh, radius_m: float, step_m: float, least_m3: float) -> Hollows:
    """The hollows of a closed mesh into which a ball of a radius does not fit.

    Args:
        mesh: Closed, facing outwards, world metres.
        radius_m: Of the ball: dents and gaps up to twice as wide are hollows.
        step_m: Between points of the lattice.
        least_m3: Smaller hollows are left out.
    """
    from scipy.ndimage import label

    margin_m = radius_m + _EXACT_STEPS * step_m
    lattice = lattice_around(mesh.bounds + np.array([[-margin_m], [margin_m]]), step_m)
    depth_m = signed_distance(mesh, lattice, _EXACT_STEPS * step_m)
    solid = depth_m > 0
    outside_m = way_to_others(~solid, step_m)
    closed_m = way_to_others(outside_m <= radius_m, step_m) - np.float32(radius_m)
    numbered: Any = label((closed_m > _ROUGH_STEPS * step_m) & ~solid)
    number, count = numbered
    points = np.bincount(number.ravel(), minlength=count + 1)[1:]
    large = points * step_m**3 >= least_m3
    renumbered = np.zeros(count + 1, dtype=np.int32)
    renumbered[1:][large] = np.arange(1, large.sum() + 1)
    number = renumbered[number]
    below_m = way_to_others(solid | (number > 0), step_m)
    return Hollows(mesh, lattice, depth_m, number, int(large.sum()), outside_m, below_m)


#: Points within this distance of a hollow are asked about it.
_AROUND_M = 0.018
#: A point tells something about a hollow where it is this far before the surface, and no further
#: below the lid of the closed one.
_BEFORE_M, _BELOW_LID_M = 0.010, 0.010
#: The lid is this thick, in steps of the lattice. With so few points it is too shallow to matter.
_LID_STEPS, _LEAST_LID = 1.5, 10
#: A place of the lid is covered by two points that lie up to so far above it and aside.
_ABOVE_M, _ASIDE_M, _COVERED_BY = 0.030, 0.009, 2
#: Least share of the lid that is covered. Of four training subjects at ``paper8``, two dents in
#: cloth have 0.46 and 0.83, and one that points pull out anyway 0.24; armpits, crotches, what is
#: between the feet and what is below the edges of clothes have at most 0.23, on a fifth 0.14.
_LEAST_COVER = 0.3
#: Width of the smoothing before outward directions are taken, in steps.
_SMOOTHED_STEPS = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Undented:
    """A start surface without the dents that photos deny.

    Attributes:
        start: The surface, with these dents filled, world metres.
        points: What photos agree on around the filled dents.
        hollows: How many hollows the surface had.
        filled_m3: (N,) volumes of those that were filled.
    """

    start: Mesh
    points: StereoPoints
    hollows: int
    filled_m3: Floats

    def details(self) -> dict[str, object]:
        """Plain JSON values for a record's reader."""
        return {
            "hollows": self.hollows,
            "filled_cm3": [round(1e6 * float(each), 1) for each in self.filled_m3],
        }


def without_dents(
    start: Mesh, views: Sequence[StereoView], task: StereoTask, settings: DentSettings
) -> Undented:
    """The start surface with its dents filled where photos show something in front of them.

    Args:
        start: Closed, facing outwards, world metres.
        views: The photos.
        task: How points are found. Hollows near its hands stay: points count for little there.
        settings: Which hollows are asked about.
    """
    found = hollows_of(start, settings.radius_m, settings.step_m, settings.least_m3)
    if found.count == 0:
        return Undented(start, joined(()), 0, np.zeros(0))
    near = _numbers_around(found)
    keep = task.settings.keep
    points = stereo_points(
        views,
        found.filled(np.ones(found.count, dtype=bool)),
        task.settings,
        lambda places: _at(found, places, near) > 0,
    ).away_from(task.hands, keep.hands_m)
    number = _at(found, points.positions, near)
    chosen = _shown(found, points, number) & ~_near(found, task.hands, keep.hands_m)
    if not chosen.any():
        return Undented(start, joined(()), found.count, np.zeros(0))
    told = points.chosen(np.concatenate([[False], chosen])[number])
    return Undented(found.filled(chosen), told, found.count, found.volumes_m3()[chosen])


def _numbers_around(found: Hollows) -> Ints32:
    """(X, Y, Z) number of the hollow that a point of the lattice is in or near; 0 of none."""
    from scipy.ndimage import grey_dilation

    numbers = found.number
    for _ in range(round(_AROUND_M / found.lattice.step_m)):
        numbers = np.where(numbers > 0, numbers, grey_dilation(numbers, size=3))
    return numbers


def _at(found: Hollows, places: Floats, values: NDArray[Any]) -> NDArray[Any]:
    """(N,) the lattice's values at the points nearest to world places (N, 3)."""
    lattice = found.lattice
    indices = np.round((places - lattice.origin) / lattice.step_m).astype(np.int64)
    return values[tuple(np.clip(indices, 0, np.array(lattice.shape) - 1).T)]


def _shown(found: Hollows, points: StereoPoints, number: Ints) -> Mask:
    """(count,) whether photos show something over each hollow's lid."""
    is_lid = (
        (found.number > 0)
        & (found.below_m <= _LID_STEPS * found.lattice.step_m)
        & (found.outside_m > _BEFORE_M)
    )
    tells = (
        (number > 0)
        & (_at(found, points.positions, found.outside_m) > _BEFORE_M)
        & (_at(found, points.positions, found.below_m) < _BELOW_LID_M)
    )
    indices = np.argwhere(is_lid)
    lid = np.bincount(found.number[is_lid], minlength=found.count + 1)[1:]
    covered = _covered(
        found.lattice.points(indices), _outward(found, indices), points.positions[tells]
    )
    share = np.bincount(found.number[is_lid], covered, minlength=found.count + 1)[1:]
    return (lid >= _LEAST_LID) & (share >= _LEAST_COVER * lid)


def _outward(found: Hollows, indices: Ints) -> Floats:
    """(N, 3) unit directions out of the hollows at some of the lattice's points (N, 3)."""
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(found.below_m, _SMOOTHED_STEPS)
    at = tuple(indices.T)
    out = -np.stack([gradient[at] for gradient in np.gradient(smooth)], axis=1)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)


def _covered(lid: Floats, outward: Floats, points: Floats) -> Mask:
    """(N,) whether points (M, 3) lie over places of a lid (N, 3), along directions (N, 3)."""
    from scipy.spatial import KDTree

    covered = np.zeros(len(lid), dtype=bool)
    if len(points) == 0:
        return covered
    reach_m = np.hypot(_ABOVE_M, _ASIDE_M)
    for place, near in enumerate(KDTree(points).query_ball_point(lid, reach_m)):
        apart = points[near] - lid[place]
        along = apart @ outward[place]
        aside = np.linalg.norm(apart - along[:, None] * outward[place], axis=1)
        over = (aside < _ASIDE_M) & (along > -_BELOW_LID_M) & (along < _ABOVE_M)
        covered[place] = over.sum() >= _COVERED_BY
    return covered


def _near(found: Hollows, places: Floats, least_m: float) -> Mask:
    """(count,) whether each hollow comes within a distance of any place (M, 3), world metres."""
    from scipy.spatial import KDTree

    near = np.zeros(found.count, dtype=bool)
    if len(places):
        indices = np.argwhere(found.number > 0)
        way, _ = KDTree(places).query(
            found.lattice.points(indices), distance_upper_bound=2 * least_m
        )
        near[found.number[tuple(indices[way < least_m].T)] - 1] = True
    return near
