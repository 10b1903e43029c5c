"""Two surfaces become millimetres: accuracy, completeness and Chamfer distance.

Points are drawn on both surfaces. How far the predicted ones lie from the true surface is the
accuracy; how far the true ones lie from the predicted surface is the completeness, which alone
punishes holes. ICON, ECON and their heirs call the completeness "P2S", PIFu the accuracy.

Chamfer is half of each direction. From points to *surfaces* two perfect copies score 0. From points
to *points* they score a sampling floor, on a single flat sheet of area A::

    500 * sqrt(A / N)    (Clark & Evans, Ecology 35, 1954)

in mm for N points; less where sheets lie closer together than points, as clothes on skin do; about
4 mm for a person.

Before: ``methods/hull.py``. After: ``harness/run/evaluate.py``.
"""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints, box_of
from harness.core.records import MetricValue
from harness.core.units import MM_PER_METRE
from harness.geometry.surface import SurfaceIndex, SurfacePoints


def nearest_surface_mm(points: Floats, surface: SurfaceIndex) -> tuple[SurfacePoints, Floats]:
    """The nearest point of a surface to each of (N, 3) points in metres, and how far it is, in mm.

    Exact: it may lie on a face, on an edge or at a vertex.
    """
    closest, distances = surface.closest(points)
    return closest, distances * MM_PER_METRE


class NearestPoints:
    """A search for the nearest of (M, 3) target points; build it once and ask it often.

    Open3D's, which finds what SciPy's tree does, to the last bit, and far points much sooner.
    """

    def __init__(self, targets: Floats) -> None:
        import open3d as o3d

        self._tensor: Any = o3d.core.Tensor
        self._search: Any = o3d.core.nns.NearestNeighborSearch(self._tensor(_whole(targets)))
        self._search.knn_index()

    def __call__(self, points: Floats) -> tuple[Floats, Ints]:
        """(N,) how far the nearest target is from each of (N, 3) points, and which it is."""
        which, squared = self._search.knn_search(self._tensor(_whole(points)), 1)
        return np.sqrt(squared.numpy().ravel()), which.numpy().ravel().astype(np.int64)


def _whole(points: Floats) -> Floats:
    return np.ascontiguousarray(points, dtype=np.float64)


def nearest_samples(points: Floats, targets: Floats) -> tuple[Floats, Ints]:
    """(N,) how far the nearest of (M, 3) target points is from each of (N, 3), and which it is."""
    return NearestPoints(targets)(points)


def near_samples(points: Floats, targets: Floats, within: float) -> Floats:
    """(N,) as ``nearest_samples`` finds, but infinite beyond a distance, which is found sooner."""
    from scipy.spatial import KDTree

    tree = KDTree(targets, balanced_tree=False, compact_nodes=False)
    # What is at the distance itself counts, however its square is rounded.
    return tree.query(points, distance_upper_bound=within * (1 + _ROUNDED))[0]


def mean_of_directions(there: MetricValue, back: MetricValue, *, together: bool) -> MetricValue:
    """Half of each direction, as in every Chamfer distance here; not their sum.

    Args:
        there: Of the predicted points.
        back: Of the true ones.
        together: Whether the two err together, as where the targets of one direction are the
            points of the other; otherwise they err independently of each other.
    """
    errors = there.standard_error, back.standard_error
    return MetricValue(
        value=(there.value + back.value) / 2,
        unit=there.unit,
        n=there.n + back.n,
        standard_error=sum(errors) / 2 if together else float(np.hypot(*errors)) / 2,
    )


def harmonic_mean(there: MetricValue, back: MetricValue) -> MetricValue:
    """An F-score of two shares; 0 where both are."""
    (p, r), total = (there.value, back.value), there.value + back.value
    if not total:
        return MetricValue(0.0, there.unit, there.n + back.n, 0.0)
    # By how much F changes with each share.
    slopes = 2 * r**2 / total**2, 2 * p**2 / total**2
    error = np.hypot(slopes[0] * there.standard_error, slopes[1] * back.standard_error)
    return MetricValue(2 * p * r / total, there.unit, there.n + back.n, float(error))


Sampling = Literal["independent", "stratified", "even"]

_MORTON_BITS, _ROUNDED = 21, 1e-9


def sample_surface(
    surface: SurfaceIndex, count: int, sampling: Sampling, seed: int
) -> SurfacePoints:
    """``count`` points, each equally likely to lie anywhere on the surface.

    Independent points know nothing of each other. Stratified ones divide the surface into ``count``
    pieces of equal area and draw one point in each; the pieces follow a space-filling curve, so
    that they are compact and the points cover the surface evenly. Even ones are what is left of
    three times as many independent ones when of two that are too close one goes, as in trimesh's
    ``sample_surface_even``; there may be fewer than ``count``.

    Args:
        surface: Its mesh is sampled; faces without area are never drawn.
        count: At least 1.
        sampling: See above.
        seed: Equal seeds on equal meshes give equal points.
    """
    generator = np.random.default_rng(seed)
    if sampling == "even":
        drawn = sample_surface(surface, 3 * count, "independent", seed)
        chosen = _apart(drawn.points, surface.area / (3 * count), generator)[:count]
        return surface.at(drawn.faces[chosen], drawn.barycentric[chosen])
    order = None
    if sampling == "stratified":
        order = np.argsort(morton_codes(_centroids(surface)))
        shares = (np.arange(count) + generator.random(count)) / count
    else:
        # In order, for neighbours are found faster one after the other; the set is the same.
        shares = np.sort(generator.random(count))
    areas = surface.face_areas
    cumulative = np.cumsum(areas if order is None else areas[order])
    picked = np.searchsorted(cumulative, shares * cumulative[-1], side="right")
    # Rounding may lift a share to the very end, where there is no face any more.
    picked = np.minimum(picked, np.searchsorted(cumulative, cumulative[-1], side="left"))
    faces = picked if order is None else order[picked]
    return surface.at(faces, _uniform_barycentric(count, generator))


def sample_mean(values: Floats, unit: str, sampling: Sampling) -> MetricValue:
    """The mean of (N,) values at sampled points, with the standard error that sampling causes.

    Neighbouring pieces of a stratified sample are alike, so it errs less than the spread of all
    values suggests: there the error is estimated from the differences between neighbours, which
    overstates it by up to a half (Wolter, Introduction to Variance Estimation, 2007, section 8.2).
    """
    count = len(values)
    if count < 2:
        variance = 0.0
    elif sampling == "stratified":
        variance = float(np.mean(np.diff(values) ** 2) / 2)
    else:
        variance = float(np.var(values, ddof=1))
    return MetricValue(
        value=float(np.mean(values)),
        unit=unit,
        n=count,
        standard_error=float(np.sqrt(variance / count)),
    )


def _apart(points: Floats, area: float, generator: np.random.Generator) -> Ints:
    """Points, in random order, that are left when pairs nearer than the root of ``area`` lose one.

    It is the one that is in more such pairs that goes, all at once, as in trimesh.
    """
    from scipy.spatial import KDTree

    order = generator.permutation(len(points))
    pairs = KDTree(points[order]).query_pairs(np.sqrt(area), output_type="ndarray")
    partners = np.bincount(pairs.ravel(), minlength=len(points))
    goes = pairs[np.arange(len(pairs)), partners[pairs].argmax(axis=1)]
    return np.delete(order, goes)


def _uniform_barycentric(count: int, generator: np.random.Generator) -> Floats:
    """(N, 3) weights of points that are uniform in a triangle (Turk, Graphics Gems, 1990)."""
    from_first = np.sqrt(generator.random(count))
    towards_third = generator.random(count)
    weights = np.empty((count, 3))
    weights[:, 0] = 1 - from_first
    weights[:, 1] = from_first * (1 - towards_third)
    weights[:, 2] = from_first * towards_third
    return weights


def _centroids(surface: SurfaceIndex) -> Floats:
    vertices, faces = surface.mesh.vertices, surface.mesh.faces
    return (vertices[faces[:, 0]] + vertices[faces[:, 1]] + vertices[faces[:, 2]]) / 3


def morton_codes(points: Floats) -> NDArray[np.uint64]:
    """(N,) places along a Z-order curve: points that are near on it are near in space."""
    low, high = box_of(points)
    size = float((high - low).max()) or 1.0
    cells = ((points - low) * ((2**_MORTON_BITS - 1) / size)).astype(np.uint64)
    x, y, z = (_spread_bits(axis) for axis in cells.T)
    return x | (y << np.uint64(1)) | (z << np.uint64(2))


def _spread_bits(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Each of the low 21 bits moved to three times its place."""
    for shift, mask in (
        (32, 0x001F00000000FFFF),
        (16, 0x001F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        values = (values | (values << np.uint64(shift))) & np.uint64(mask)
    return values
