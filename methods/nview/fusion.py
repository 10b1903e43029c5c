"""The rounds of the fusion: from the start surface to one that agrees with all views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Ints, Mask, Singles
from harness.core.mesh import Mesh
from harness.core.process.threads import on_all_cores
from harness.geometry.surface import vertex_normals
from methods.closed.lattices import remeshed
from methods.closed.surfaces import (
    SignedOutline,
    Surface,
    lengths,
    outlines_distance,
    smoothed_along,
    unit,
    vertex_sums,
)
from methods.nview.settings import FusionSettings
from methods.nview.system import (
    FusedTargets,
    MoveProblem,
    PairRows,
    SingleRows,
    check_not_flipped,
    fused_targets,
    slope_rows,
)
from methods.nview.views import FusionView
from methods.surface.fusion import one_piece

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
    facing = np.einsum("ij,ij->i", normals, unit(view.camera.eye_of(vertices) - vertices))
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
    eye = view.camera.eye_of(beside)
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


#: The surface rests where its vertices move by less than this in a round, millimetres, by root mean
#: square: a fiftieth of an edge.
_REST_MM = 0.1
#: What reaches further than this beyond an outline is cut off at the end, metres. On a training
#: subject 5 % of the vertices are more than half a millimetre outside before, 0.03 % more than two;
#: cutting at half a millimetre leaves a ladder of creases along the contours.
_CUT_M = 0.002
#: Weight of the mesh's own normal against a believed target's in the contour.
_OWN_SHARE = 0.3
#: Every face asks for its own smoothed slope by at least this.
_LEAST_REGULARITY = 1e-4
#: A deflating move weighs as a slope of 1 over this length, metres.
_DEFLATION_LENGTH_M = 0.02
#: The share of phantom faces around a vertex from which on it is deflated, and within which it is
#: fully; after so many rounds of averaging.
_PHANTOM_FROM, _PHANTOM_WITHIN, _PHANTOM_ROUNDS = 0.35, 0.3, 4
#: A surface that photos placed stays as a slope of 1 over this length, metres, and is as smooth as
#: this share of a believed normal asks. Half and twice the share, and 8 to 25 mm, were tried.
_SETTLED_LENGTH_M, _SETTLED_SMOOTHNESS = 0.012, 0.3
#: Rounds in which moves are averaged with their neighbours', against ripples of one edge.
_LOW_PASS = 2
#: Rounds of spreading vertices along the surface after a move, and share of the way.
_SPREAD_ROUNDS, _SPREAD_SHARE = 2, 0.4


@dataclass(frozen=True, slots=True)
class RoundReport:
    """What one round did.

    Attributes:
        vertices: How many the surface had.
        angle_deg: Mean angle between faces and their targets before it, by area and confidence.
        believed: Share of the area that a view speaks for.
        contradicted: Share of the area that the views see and where they contradict each other or
            the surface: what is left of it at the end is volume that may not be the subject's.
        moved_mm: Root mean square of the moves.
    """

    vertices: int
    angle_deg: float
    believed: float
    contradicted: float
    moved_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Fused:
    """A fused surface and the way to it.

    Attributes:
        mesh: Closed, in one piece, world metres.
        rounds: What each did.
        from_hull: Whether it started from the hull because another start lost a limb.
    """

    mesh: Mesh
    rounds: tuple[RoundReport, ...]
    from_hull: bool = False

    def details(self) -> dict[str, object]:
        """Plain JSON values for a record's reader."""
        return {
            "rounds": len(self.rounds),
            "from_hull": self.from_hull,
            "angle_to_targets_deg": [round(report.angle_deg, 2) for report in self.rounds],
            "moved_mm": [round(report.moved_mm, 3) for report in self.rounds],
            "contradicted_share": [round(report.contradicted, 4) for report in self.rounds],
            "believed_share": [round(report.believed, 3) for report in self.rounds],
        }


def fused_surface(start: Mesh, views: Sequence[FusionView], settings: FusionSettings) -> Fused:
    """The surface that the views' normals and outlines agree on.

    Args:
        start: Closed, world metres, edges of about ``settings.voxel_m``.
        views: All of them.
        settings: The fusion's settings.

    Raises:
        MethodError: normals that are mirrored, or a surface that vanishes.
    """
    surface = Surface(start)
    check_not_flipped(surface, views)
    reports: list[RoundReport] = []
    for number in range(settings.rounds):
        surface, report = moved_once(surface, views, settings, number)
        reports.append(report)
        step_m = settings.remade_step_m(number)
        if step_m is not None:
            surface = Surface(remeshed(surface.mesh, step_m))
        elif report.moved_mm < _REST_MM and number >= settings.deflation_rounds:
            break
    return Fused(finished_surface(surface.mesh, views, settings), tuple(reports))


def finished_surface(mesh: Mesh, views: Sequence[FusionView], settings: FusionSettings) -> Mesh:
    """The surface made anew: closed, free of crossings, inside all outlines.

    Args:
        mesh: World metres; it may run through itself.
        views: All of them; they cut, unless outlines are off.
        settings: The fusion's settings.
    """
    if settings.outlines == "off":
        return one_piece(remeshed(mesh, settings.fine_m))
    outlines = [view.outline for view in views]

    def within(points: Floats) -> Singles:
        return outlines_distance(outlines, points) + np.float32(_CUT_M)

    return one_piece(remeshed(mesh, settings.fine_m, within))


def moved_once(
    surface: Surface, views: Sequence[FusionView], settings: FusionSettings, number: int
) -> tuple[Surface, RoundReport]:
    """The surface after round ``number`` (from 0), and what the round did."""
    targets = fused_targets(surface, views, settings, number)
    angle_deg = _angles_deg(surface, targets)
    problem = MoveProblem(len(surface.mesh.vertices))
    if settings.outlines == "on":
        rules = RimRules.of_round(settings, number)
        problem.add_pairs(rim_rows(surface, views, _asked_at_vertices(surface, targets), rules))
        for rows in outside_rows(surface, [view.outline for view in views], settings.rim_m):
            problem.add_single(rows)
    problem.add_single(_staying(surface, 0.0, 1.0, settings.weak_m))
    weights = targets.confidence
    if number >= settings.doubt_from:
        weights = weights / (1 + (angle_deg / settings.doubt_deg) ** 2)
    if number < settings.deflation_rounds:
        phantom = _phantom_at_vertices(surface, targets)
        weights = weights * (1 - phantom[surface.mesh.faces].mean(axis=1))
        inward = _staying(surface, -settings.deflation_m, phantom, _DEFLATION_LENGTH_M)
        problem.add_single(inward)
    problem.add_pairs(slope_rows(surface, targets.normals, weights))
    regularity = settings.regularity * (1 - targets.confidence) + _LEAST_REGULARITY
    problem.add_pairs(slope_rows(surface, surface.smooth_face_normals, regularity))
    moves = _checked_moves(surface, problem.solved(), settings.step_m)
    report = _report(surface, targets, angle_deg, moves)
    vertices = surface.mesh.vertices + moves[:, None] * surface.directions
    return smoothed_along(surface.moved(vertices), _SPREAD_ROUNDS, _SPREAD_SHARE), report


def settled(mesh: Mesh, views: Sequence[FusionView], settings: FusionSettings) -> Mesh:
    """The mesh with its rims on the outlines, without ripples, and otherwise where it is.

    Photos place what faces them, not rims: pulled to them, thin parts end a millimetre or two
    inside their outlines, and each vertex has an error of its own. On three training subjects this
    takes 0.4 to 1 degree off, and silhouettes have an IoU of 0.993 instead of 0.985.

    Args:
        mesh: Closed, world metres, within millimetres of the subject.
        views: All of them.
        settings: The fusion's settings.
    """
    surface = Surface(mesh)
    problem = MoveProblem(len(mesh.vertices))
    if settings.outlines == "on":
        rules = RimRules.of_round(settings, settings.late_from)
        problem.add_pairs(rim_rows(surface, views, vertex_normals(mesh), rules))
        for rows in outside_rows(surface, [view.outline for view in views], settings.rim_m):
            problem.add_single(rows)
    problem.add_single(_staying(surface, 0.0, 1.0, _SETTLED_LENGTH_M))
    weights = np.full(len(mesh.faces), _SETTLED_SMOOTHNESS)
    problem.add_pairs(slope_rows(surface, surface.smooth_face_normals, weights))
    moves = np.clip(problem.solved(), -settings.step_m, settings.step_m)
    return surface.moved(mesh.vertices + moves[:, None] * surface.directions).mesh


def _angles_deg(surface: Surface, targets: FusedTargets) -> Floats:
    """(F,) between each face and its target."""
    cosine = np.einsum("ij,ij->i", targets.normals, surface.face_normals)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def _asked_at_vertices(surface: Surface, targets: FusedTargets) -> Floats:
    """(V, 3) unit normals asked for around each vertex; the surface's own where nothing is."""
    own = _OWN_SHARE * (1 - targets.confidence) * surface.areas_m2
    asked = (targets.confidence * surface.areas_m2)[:, None] * targets.normals
    total = asked + own[:, None] * surface.face_normals
    return unit(vertex_sums(surface.mesh.faces, total, len(surface.mesh.vertices)))


def _phantom_at_vertices(surface: Surface, targets: FusedTargets) -> Floats:
    """(V,) 0 to 1, how far each vertex is in the middle of phantom surface."""
    share = surface.at_vertices(targets.phantom)
    for _ in range(_PHANTOM_ROUNDS):
        share = 0.5 * share + 0.5 * surface.neighbours.means(share)
    return np.clip((share - _PHANTOM_FROM) / _PHANTOM_WITHIN, 0, 1)


def _staying(
    surface: Surface, move_m: float, weights: Floats | float, length_m: float
) -> SingleRows:
    """Rows that ask every vertex for one move, weighted (V,) as a slope over a length."""
    count = len(surface.mesh.vertices)
    return SingleRows(
        np.arange(count),
        np.ones(count),
        np.full(count, move_m),
        weights * surface.vertex_areas_m2 / length_m**2,
    )


def _checked_moves(surface: Surface, moves: Floats, most_m: float) -> Floats:
    """Moves (V,) without ripples and none longer than allowed."""
    for _ in range(_LOW_PASS):
        moves = 0.5 * moves + 0.5 * surface.neighbours.means(moves)
    return np.clip(moves, -most_m, most_m)


def _report(
    surface: Surface, targets: FusedTargets, angle_deg: Floats, moves: Floats
) -> RoundReport:
    believed = targets.confidence * surface.areas_m2
    area = surface.vertex_areas_m2
    return RoundReport(
        vertices=len(surface.mesh.vertices),
        angle_deg=float((angle_deg * believed).sum() / max(believed.sum(), 1e-12)),
        believed=float(believed.sum() / surface.areas_m2.sum()),
        contradicted=float((targets.phantom * surface.areas_m2).sum() / surface.areas_m2.sum()),
        moved_mm=1000 * float(np.sqrt((moves**2 * area).sum() / area.sum())),
    )
