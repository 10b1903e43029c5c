"""A closed mesh as a membrane: averages over neighbours, and motions that are smooth along it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.mesh import Mesh
from harness.geometry.coinciding import components, edges_of
from harness.geometry.solving import solved
from harness.geometry.surface import vertex_normals

#: Holds vertices without data where they are, against 1 for a point.
_HOLD = 1e-3


def unit(vectors: Floats) -> Floats:
    """(N, 3) vectors at unit length; nothing stays nothing."""
    length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return vectors / np.where(length > 0, length, 1.0)[:, None]


class Neighbourhood:
    """Who is beside whom on a mesh."""

    def __init__(self, mesh: Mesh) -> None:
        from scipy.sparse import csr_array, diags_array

        self.mesh = mesh
        count = len(mesh.vertices)
        self._edges: Ints = edges_of(mesh.faces).ends
        first, second = np.concatenate([self._edges, self._edges[:, ::-1]]).T
        adjacent = csr_array((np.ones(len(first)), (first, second)), shape=(count, count))
        degree = np.asarray(adjacent.sum(axis=1)).ravel()
        self._mean: Any = diags_array(1.0 / np.maximum(degree, 1.0)) @ adjacent
        self._stiffness: Any = diags_array(degree) - adjacent

    @cached_property
    def areas_m2(self) -> Floats:
        """(V,) a third of the area of the faces at each vertex."""
        areas: Floats = np.zeros(len(self.mesh.vertices))
        np.add.at(areas, self.mesh.faces, self.mesh.face_areas()[:, None] / 3.0)
        return areas

    def averaged(self, values: Floats, times: int) -> Floats:
        """(V,) or (V, C) values, half replaced by their neighbours' mean as often as told."""
        for _ in range(times):
            values = 0.5 * values + 0.5 * (self._mean @ values)
        return values

    def smooth_normals(self, times: int) -> Floats:
        """(V, 3) unit vertex normals, averaged over neighbours as often as told."""
        normals = vertex_normals(self.mesh)
        for _ in range(times):
            normals = unit(0.5 * normals + 0.5 * (self._mean @ normals))
        return normals

    def patch_areas_m2(self, values: Floats, where: Mask, step: float) -> Floats:
        """(V,) the area of the patch that a vertex belongs to, square metres; 0 elsewhere.

        Args:
            values: (V,) what is alike in a patch: neighbours in it differ by less than ``step``.
            where: (V,) which vertices belong to patches at all.
            step: See ``values``; in their unit.
        """
        first, second = self._edges.T
        alike = where[first] & where[second] & (np.abs(values[first] - values[second]) < step)
        patch = components(len(self.mesh.vertices), first[alike], second[alike])
        area = np.bincount(patch, self.areas_m2 * where).astype(np.float64)
        return area[patch] * where

    def motion(self, offsets: Floats, weights: Floats, membrane_m: float) -> Floats:
        """(V,) the smooth motion t that comes nearest to wanted ones.

        The least of the sum over vertices of area (w (t - o)^2 + 0.001 t^2) plus membrane_m^2 times
        the squared differences along edges.

        Args:
            offsets: (V,) the wanted ones, metres.
            weights: (V,) how much each counts; 0 where nothing is known.
            membrane_m: Over which length a motion spreads, metres.
        """
        from scipy.sparse import diags_array

        diagonal = self.areas_m2 * (weights + _HOLD) + 1e-14
        matrix = diags_array(diagonal) + membrane_m**2 * self._stiffness
        return solved(matrix, self.areas_m2 * weights * offsets)


#: Over how many neighbours the two are averaged: about 3 cm of surface.
_SPREAD = 12
#: Offsets below this need no proof, metres: they change nothing that can be measured.
_NOTHING_M = 0.0003
#: A neighbourhood with less than this share of vertices that both groups see follows the whole.
_ENOUGH = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How two groups of views agree on the offsets of a surface.

    Attributes:
        share: (V,) 0 to 1, by how much each vertex' offset is believed.
        overall: The same of the whole surface.
        error_m: Standard deviation of one group's offsets, from their differences; NaN where no
            vertex is seen by both.
        compared: Share of the vertices that both groups see.
    """

    share: Floats
    overall: float
    error_m: float
    compared: float


def agreement(first: Floats, second: Floats, around: Neighbourhood) -> Agreement:
    """How far the offsets of two groups of views are believed.

    Args:
        first: (V,) metres; NaN where the group says nothing.
        second: (V,) the same of the other group.
        around: Neighbours in the mesh whose vertices they move.
    """
    both = np.isfinite(first) & np.isfinite(second)
    if not both.any():
        return Agreement(np.zeros(len(first)), 0.0, float("nan"), 0.0)
    apart = np.square(np.where(both, first - second, 0.0))
    size = np.where(both, (first**2 + second**2) / 2.0, 0.0)
    overall = float(_truth_share(apart[both].mean(), size[both].mean()))
    weight = around.averaged(both.astype(np.float64), _SPREAD)
    near = _truth_share(
        around.averaged(apart, _SPREAD) / np.maximum(weight, 1e-9),
        around.averaged(size, _SPREAD) / np.maximum(weight, 1e-9),
    )
    return Agreement(
        share=np.where(weight > _ENOUGH, near, overall),
        overall=overall,
        # The median is not the few wrong ones': 0.6745 of a normal distribution's deviation.
        error_m=float(np.median(np.sqrt(apart[both])) / 0.6745 / np.sqrt(2.0)),
        compared=float(both.mean()),
    )


def _truth_share(apart: Floats | np.floating, size: Floats | np.floating) -> Floats:
    """Wiener's weight of a mean of two, from mean squares of their difference and of their size."""
    truth = size + _NOTHING_M**2 - apart / 2.0
    return np.clip(truth / np.maximum(truth + apart / 4.0, 1e-12), 0.0, 1.0)
