"""Points drawn on a surface, uniformly by area, and what a mean over them is worth."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints
from harness.core.results import MetricValue
from harness.geometry.surface import SurfaceIndex, SurfacePoints

Sampling = Literal["independent", "stratified", "even"]

_MORTON_BITS = 21


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
    areas = surface.face_areas
    if sampling == "stratified":
        order = np.argsort(_morton_codes(_centroids(surface)))
        shares = (np.arange(count) + generator.random(count)) / count
    else:
        order = np.arange(len(areas))
        # In order, for neighbours are found faster one after the other; the set is the same.
        shares = np.sort(generator.random(count))
    cumulative = np.cumsum(areas[order])
    picked = np.searchsorted(cumulative, shares * cumulative[-1], side="right")
    # Rounding may lift a share to the very end, where there is no face any more.
    last = np.searchsorted(cumulative, cumulative[-1], side="left")
    return surface.at(order[np.minimum(picked, last)], _uniform_barycentric(count, generator))


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


def _morton_codes(points: Floats) -> NDArray[np.uint64]:
    """(N,) places along a Z-order curve: points that are near on it are near in space."""
    low = points.min(axis=0)
    size = float((points.max(axis=0) - low).max()) or 1.0
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
