"""Rows that draw the surface's own outline to the outline of each photo, and hold it inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.process.threads import on_all_cores
from methods.closed.outlines import SignedOutline
from methods.closed.surfaces import Surface, lengths, unit
from methods.nview.settings import FusionSettings
from methods.nview.system import PairRows, SingleRows
from methods.nview.views import FusionView

#: A rim's outward direction in the picture and its normal agree by at least this cosine.
_LEAST_AGREEMENT = 0.7
#: A ray this far beside a rim, metres, misses the surface: early, and from the late round on.
_BESIDE_M, _BESIDE_LATE_M = 0.006, 0.003
#: How far outside an outline a vertex may be, metres: half a millimetre is within the noise of
#: outlines placed by coverage.
_SLACK_M = 0.0005


@dataclass(frozen=True, slots=True)
class RimRules:
    """Which rims are drawn to outlines in one round.

    Attributes:
        reach_m: About how far off they may be.
        beside_m: A ray this far beside a rim misses the surface.
        length_m: A metre off weighs as a slope of 1 over this length.
    """

    reach_m: float
    beside_m: float
    length_m: float

    @classmethod
    def of_round(cls, settings: FusionSettings, number: int) -> RimRules:
        """The rules of a round, counted from 0."""
        if number < settings.late_from:
            return cls(settings.rim_reach_m, _BESIDE_M, settings.rim_m)
        return cls(settings.rim_reach_late_m, _BESIDE_LATE_M, settings.rim_m)


def rim_rows(
    surface: Surface, views: Sequence[FusionView], normals: Floats, rules: RimRules
) -> list[PairRows]:
    """For each view, rows that move the surface's contour onto the outline.

    The contour is where normals turn from the viewer. Those asked for by the views decide, not the
    surface's own: a flat facet of the visual hull is everywhere about to turn, a face that is to be
    flat is not.

    Args:
        surface: Vertices move along its ``directions``.
        views: All of them.
        normals: (V, 3) unit normals that the surface should have.
        rules: The round's rules.
    """
    return on_all_cores(lambda view: _rows_of(surface, view, normals, rules), views)


@dataclass(frozen=True, slots=True, eq=False)
class _Contour:
    """Points on edges at which normals turn from the viewer.

    Attributes:
        first, second: (K,) the edge's vertices.
        share: (K,) how far along the edge the point lies.
    """

    first: Ints
    second: Ints
    share: Floats

    def kept(self, keep: Mask) -> _Contour:
        return _Contour(self.first[keep], self.second[keep], self.share[keep])

    def blended(self, values: Floats) -> Floats:
        """(K, 3) values of vertices (V, 3) at the points."""
        share = self.share[:, None]
        return values[self.first] * (1 - share) + values[self.second] * share


def _rows_of(surface: Surface, view: FusionView, normals: Floats, rules: RimRules) -> PairRows:
    vertices, outline = surface.mesh.vertices, view.outline
    facing = np.einsum("ij,ij->i", normals, unit(view.camera.position - vertices))
    first, second = surface.neighbours.edges.T
    turns = facing[first] * facing[second] < 0
    first, second = first[turns], second[turns]
    contour = _Contour(first, second, facing[first] / (facing[first] - facing[second]))
    contour = contour.kept(
        np.abs(outline.distances_m(contour.blended(vertices))) < 2 * rules.reach_m
    )
    contour = contour.kept(_on_outline(surface, view, contour, normals, rules.beside_m))
    points = contour.blended(vertices)
    off_m = outline.distances_m(points)
    slope = outline.slopes(points, unit(contour.blended(surface.directions)))
    edge_m = lengths(vertices[contour.first] - vertices[contour.second])
    return PairRows(
        first=contour.first,
        second=contour.second,
        a=slope * (1 - contour.share),
        b=slope * contour.share,
        values=-off_m,
        weights=(edge_m / rules.length_m) ** 2 * np.exp(-((off_m / rules.reach_m) ** 2)),
    )


def _on_outline(
    surface: Surface, view: FusionView, contour: _Contour, normals: Floats, beside_m: float
) -> Mask:
    """(K,) whether points of the contour are on the surface's own outline in the view."""
    points = contour.blended(surface.mesh.vertices)
    inward = view.outline.inward(points)
    keep = -np.einsum("ij,ij->i", inward, unit(contour.blended(normals))) > _LEAST_AGREEMENT
    agreeing = np.flatnonzero(keep)
    beside = points[agreeing] - beside_m * inward[agreeing]
    eye = np.broadcast_to(view.camera.position, beside.shape)
    keep[agreeing] = ~surface.caster.blocked(eye, beside - eye)
    return keep


def outside_rows(
    surface: Surface, outlines: Sequence[SignedOutline], length_m: float
) -> list[SingleRows]:
    """For each outline, rows that move vertices outside it back to it."""

    def rows_of(outline: SignedOutline) -> SingleRows:
        off_m = outline.distances_m(surface.mesh.vertices)
        vertices = np.flatnonzero(off_m < -_SLACK_M)
        slope = outline.slopes(surface.mesh.vertices[vertices], surface.directions[vertices])
        weights = surface.vertex_areas_m2[vertices] / length_m**2
        return SingleRows(vertices, slope, -off_m[vertices] - _SLACK_M, weights)

    return on_all_cores(rows_of, outlines)
