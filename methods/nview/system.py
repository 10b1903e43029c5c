"""One sparse linear least-squares problem: how far each vertex moves along its direction."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import AnyInts, Floats, Ints, Mask
from harness.core.errors import MethodError
from harness.core.process.threads import on_all_cores
from harness.geometry.solving import solved
from methods.closed.surfaces import Surface, lengths, unit
from methods.nview.settings import FusionSettings
from methods.nview.views import FusionView, NormalTargets

#: Keeps a vertex that no row holds where it is.
_RIDGE = 1e-12
#: Squares of edges shorter than a third of a millimetre count as that.
_SHORTEST_M2 = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class SingleRows:
    """Rows ``weight * (coefficient * t[vertex] - value) ** 2``.

    Attributes:
        vertices: (K,) indices.
        coefficients, values, weights: (K,).
    """

    vertices: AnyInts
    coefficients: Floats
    values: Floats
    weights: Floats


@dataclass(frozen=True, slots=True, eq=False)
class PairRows:
    """Rows ``weight * (a * t[first] + b * t[second] - value) ** 2``.

    Attributes:
        first, second: (K,) vertex indices.
        a, b, values, weights: (K,).
    """

    first: AnyInts
    second: AnyInts
    a: Floats
    b: Floats
    values: Floats
    weights: Floats


class MoveProblem:
    """Collects rows and solves for one move per vertex, metres.

    Args:
        count: Number of vertices.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._diagonal = np.full(count, _RIDGE)
        self._right = np.zeros(count)
        self._pairs: list[tuple[AnyInts, AnyInts, Floats]] = []

    def add_single(self, rows: SingleRows) -> None:
        """Rows with one unknown each."""
        weighted = rows.weights * rows.coefficients
        self._add_at(rows.vertices, weighted * rows.coefficients, weighted * rows.values)

    def add_pairs(self, parts: Iterable[PairRows]) -> None:
        """Rows with two unknowns each."""
        for rows in parts:
            first, second = rows.weights * rows.a, rows.weights * rows.b
            self._add_at(rows.first, first * rows.a, first * rows.values)
            self._add_at(rows.second, second * rows.b, second * rows.values)
            self._pairs.append((rows.first, rows.second, first * rows.b))

    def _add_at(self, vertices: AnyInts, diagonal: Floats, right: Floats) -> None:
        self._diagonal += np.bincount(vertices, diagonal, self._count)
        self._right += np.bincount(vertices, right, self._count)

    def solved(self) -> Floats:
        """(V,) moves that minimise the sum of all rows."""
        return solved(self.matrix(), self._right)

    def matrix(self):  # noqa: ANN201
        """(V, V) the symmetric matrix of the normal equations."""
        from scipy.sparse import csr_array

        vertices = np.arange(self._count)
        first = np.concatenate([vertices, *(part[0] for part in self._pairs)])
        second = np.concatenate([vertices, *(part[1] for part in self._pairs)])
        # Half of the diagonal, because the transpose is added.
        values = np.concatenate([self._diagonal / 2, *(part[2] for part in self._pairs)])
        half = csr_array((values, (first, second)), shape=(self._count, self._count))
        return half + half.T


def slope_rows(surface: Surface, normals: Floats, weights: Floats) -> Iterable[PairRows]:
    """Rows that ask the edges of each face to be square to a normal.

    After Nehab et al., "Efficiently combining positions and normals for precise 3D geometry", 2005.

    Args:
        surface: Vertices move along its ``directions``.
        normals: (F, 3) unit; the edges of a face are asked to be square to its normal.
        weights: (F,) of each face's three rows, on top of its area.
    """
    vertices, directions = surface.mesh.vertices, surface.directions
    used = np.flatnonzero(weights > 0)
    faces, asked = surface.mesh.faces[used], normals[used]
    weight = weights[used] * surface.areas_m2[used]
    along = [np.einsum("ij,ij->i", asked, directions[corner]) for corner in faces.T]
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = vertices[faces[:, start]] - vertices[faces[:, end]]
        squared = np.maximum(np.einsum("ij,ij->i", edge, edge), _SHORTEST_M2)
        yield PairRows(
            first=faces[:, start],
            second=faces[:, end],
            a=along[start],
            b=-along[end],
            values=-np.einsum("ij,ij->i", asked, edge),
            weights=weight / squared,
        )


#: A face is asked of a view if it looks at it by at least this cosine.
_LEAST_FACING = 0.03
#: Rays to the cameras start this far above the surface, metres.
_LIFT_M = 0.002
#: A view's normal that differs from the face's by more than this cosine is another surface's:
#: while phantom volume is moved away, and after that.
_ANOTHER_EARLY, _ANOTHER = -0.5, 0.0
#: Rounds of reweighting by the angle to the mean.
_ROUNDS = 2
#: Phantom surface: from 40 degrees of contradiction on in part, from 55 on fully; views that
#: cancel each other to 60 % of their length count as 54 degrees.
_PHANTOM_FROM_DEG, _PHANTOM_WITHIN_DEG, _CANCELLED_DEG = 40.0, 15.0, 135.0
#: Least sum of weights with which views can contradict a face.
_LEAST_SEEN = 0.2
#: Correlation of the maps' components with the start's, below which a map is mirrored; mirrored
#: maps of people have about -0.9, good ones 0.9.
_MIRRORED = -0.3
#: Share of a map's normals that may point away from its camera.
_MOST_AWAY = 0.5
#: Spread of a component that can be correlated.
_LEAST_SPREAD = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Every normal that a view gives for a face that it sees.

    Attributes:
        faces: (K,) which face.
        normals: (K, 3) unit, world frame.
        weights: (K,) how far the view is believed there.
    """

    faces: Ints
    normals: Floats
    weights: Floats

    def summed(self, weights: Floats, count: int) -> Floats:
        """(count, 3) sums of the normals at each face under other weights (K,)."""
        columns = [np.bincount(self.faces, weights * column, count) for column in self.normals.T]
        return np.stack(columns, axis=1).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FusedTargets:
    """What the views ask of each face.

    Attributes:
        normals: (F, 3) unit, world frame; 0 where nothing is asked.
        confidence: (F,) 0 to 1.
        phantom: (F,) 0 to 1: how far the views contradict each other or the face, as they do on
            surface that only the hull has.
    """

    normals: Floats
    confidence: Floats
    phantom: Floats


def fused_targets(
    surface: Surface, views: Sequence[FusionView], settings: FusionSettings, number: int
) -> FusedTargets:
    """The targets of round ``number`` (from 0) on a surface."""
    another = _ANOTHER_EARLY if number < settings.deflation_rounds else _ANOTHER
    seen = sightings(surface, views, settings.facing_power, another)
    count = len(surface.mesh.faces)
    weights = seen.weights
    for _ in range(_ROUNDS):
        mean = unit(seen.summed(weights, count))
        cosine = np.einsum("ij,ij->i", seen.normals, mean[seen.faces])
        angle_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        weights = seen.weights * np.exp(-((angle_deg / settings.disagreement_deg) ** 2))
    total = seen.summed(weights, count)
    return FusedTargets(unit(total), np.clip(lengths(total), 0, 1), _phantom(surface, seen, count))


def sightings(
    surface: Surface, views: Sequence[FusionView], facing_power: float, another: float
) -> Sightings:
    """The normals of all views at the middles of the faces that they see.

    Args:
        surface: The surface so far.
        views: Those without normals give none.
        facing_power: Exponent of the cosine to the line of sight in the weight.
        another: Least cosine between a view's normal and the face's own.
    """
    given = [(view, view.targets) for view in views if view.targets is not None]
    parts = on_all_cores(lambda each: _seen_by(*each, surface, facing_power, another), given)
    if not parts:
        return Sightings(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0))
    return Sightings(
        np.concatenate([part.faces for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.weights for part in parts]),
    )


def _seen_by(
    view: FusionView,
    targets: NormalTargets,
    surface: Surface,
    facing_power: float,
    another: float,
) -> Sightings:
    rays = unit(view.camera.eye_of(surface.centroids) - surface.centroids)
    facing = np.einsum("ij,ij->i", surface.face_normals, rays)
    faces = np.flatnonzero(facing > _LEAST_FACING)
    origins = surface.centroids[faces] + _LIFT_M * surface.face_normals[faces]
    faces = faces[~surface.caster.blocked(origins, rays[faces])]
    normals, weights = _sampled(targets, surface.centroids[faces])
    weights *= np.clip(np.einsum("ij,ij->i", normals, rays[faces]), 0, 1) ** facing_power
    weights *= np.einsum("ij,ij->i", normals, surface.face_normals[faces]) > another
    is_given = weights > 0
    return Sightings(faces[is_given], normals[is_given], weights[is_given])


def _sampled(targets: NormalTargets, points_world: Floats) -> tuple[Floats, Floats]:
    """Unit normals (N, 3) of a map at projected world points, and its weights (N,) there."""
    from scipy.ndimage import map_coordinates

    pixels, _ = targets.camera.project(points_world)
    pixels = np.nan_to_num(pixels, nan=-1.0)
    rows_columns = pixels[:, ::-1].T - 0.5
    blended = np.stack(
        [
            map_coordinates(targets.normals_world[..., axis], rows_columns, order=1)
            for axis in range(3)
        ],
        axis=1,
    ).astype(np.float64)
    size = np.array(targets.camera.size)
    inside = ((pixels >= 0) & (pixels < size)).all(axis=1)
    columns, rows = np.clip(pixels, 0, size - 1).astype(np.int64).T
    # Half a pixel beyond the mask a blended normal is still there, and is the background's, too.
    inside &= targets.normals_world[rows, columns].any(axis=1)
    weights = inside.astype(np.float64)
    if targets.weights is not None:
        weights *= targets.weights[rows, columns]
    return unit(blended), weights


def _phantom(surface: Surface, seen: Sightings, count: int) -> Floats:
    total = seen.summed(seen.weights, count)
    weight = np.bincount(seen.faces, seen.weights, count)
    agreement = lengths(total) / np.maximum(weight, 1e-9)
    cosine = np.einsum("ij,ij->i", unit(total), surface.face_normals)
    angle_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    against_deg = np.maximum(angle_deg, _CANCELLED_DEG * (1 - agreement))
    share = (against_deg - _PHANTOM_FROM_DEG) / _PHANTOM_WITHIN_DEG
    return (weight > _LEAST_SEEN) * np.clip(share, 0, 1)


def trust(errors_deg: Floats, mask: Mask, trusted_deg: float) -> Floats:
    """(H, W) weights of normals that are expected to be off by errors (H, W) within a mask (H, W).

    A normal's weight falls with its variance; one that is off by ``trusted_deg`` counts half as
    much as an exact one. The median over the mask is 1, so that a view as a whole counts as much as
    one whose errors nobody knows.
    """
    weights = 1.0 / (1.0 + (errors_deg / trusted_deg) ** 2)
    return weights / np.median(weights[mask])


def check_not_flipped(surface: Surface, views: Sequence[FusionView]) -> None:
    """Refuse normals that are mirrored or inside out against the surface to start from.

    Raises:
        MethodError: naming the view and the direction.
    """
    for view in views:
        if view.targets is None:
            continue
        _check_towards(view, view.targets)
        seen = _seen_by(view, view.targets, surface, 0.0, -2.0)
        if len(seen.faces) == 0:
            continue
        theirs = seen.normals @ view.camera.rotation.T
        ours = surface.face_normals[seen.faces] @ view.camera.rotation.T
        for axis, name in ((0, "left to right"), (1, "top to bottom")):
            correlation = _correlation(theirs[:, axis], ours[:, axis])
            if correlation < _MIRRORED:
                raise MethodError(
                    f"the normals of view {view.index} are mirrored from {name}",
                    expected="outward normals, in the world frame",
                    got=f"a correlation of {correlation:.2f} with the visual hull's",
                    hint="Check the frame of the maps, and that each view has its own camera",
                )


def _check_towards(view: FusionView, targets: NormalTargets) -> None:
    """Refuse a map whose normals mostly point away from the camera."""
    rows, columns = np.nonzero(targets.normals_world.any(axis=2))
    pixels = np.stack([columns, rows], axis=1) + 0.5
    away = np.einsum(
        "ij,ij->i", targets.camera.ray_directions(pixels), targets.normals_world[rows, columns]
    )
    share = float((away > 0).mean()) if len(away) else 0.0
    if share > _MOST_AWAY:
        raise MethodError(
            f"the normals of view {view.index} point away from its camera",
            expected="outward normals, in the world frame",
            got=f"{share:.0%} that face away",
            hint="Check the frame of the maps",
        )


def _correlation(first: Floats, second: Floats) -> float:
    """Pearson's; 1 where one of them is constant."""
    if min(first.std(), second.std()) < _LEAST_SPREAD:
        return 1.0
    return float(np.corrcoef(first, second)[0, 1])
