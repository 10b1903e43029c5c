"""The hollows of a solid: what closing it by a ball fills."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints32, Mask, Singles
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
