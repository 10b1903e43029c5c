"""Two surfaces become millimetres: accuracy, completeness and Chamfer distance.

Points are drawn on both surfaces. How far the predicted ones lie from the true surface is the
accuracy; how far the true ones lie from the predicted surface is the completeness, which alone
punishes holes. Chamfer combines both directions. Nothing here moves, scales or crops anything.

Before: ``methods/hull.py``. After: ``harness/pipeline/run/evaluate.py``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.core.arrays import Floats
from harness.core.results import MetricValue
from harness.core.units import MM_PER_METRE, Unit
from harness.geometry.surface import SurfaceIndex, SurfacePoints
from metrics.sampling import Sampling, sample_mean

_MM = Unit.millimetre.value


def nearest_surface_mm(points: Floats, surface: SurfaceIndex) -> tuple[SurfacePoints, Floats]:
    """The nearest point of a surface to each of (N, 3) points in metres, and how far it is, in mm.

    Exact: it may lie on a face, on an edge or at a vertex.
    """
    closest, distances = surface.closest(points)
    return closest, distances * MM_PER_METRE


def nearest_sample_mm(points: Floats, targets: Floats) -> Floats:
    """(N,) how far the nearest of (M, 3) target points is from each of (N, 3) points, in mm."""
    from scipy.spatial import KDTree

    distances, _ = KDTree(targets).query(points, workers=-1)
    return distances * MM_PER_METRE


def point_to_surface(distances_mm: Floats, sampling: Sampling) -> MetricValue:
    """Mean distance from one surface to the other, in mm.

    With s drawn by area on one surface S, and T the other::

        1000 * mean_s min_{t in T} |s - t|

    It is the *accuracy* if S is the prediction and T the truth, and the *completeness* the other
    way round. Two perfect copies score 0.

    Source: MExECON, "P2S Acc." and "P2S Comp."; ICON and ECON call the second alone "P2S".
    """
    return sample_mean(distances_mm, _MM, sampling)


def chamfer_point_to_surface(accuracy: MetricValue, completeness: MetricValue) -> MetricValue:
    """The mean of accuracy and completeness, in mm; two perfect copies score 0.

    Source: ICON and ECON, whose values are in cm of a normalised body.
    """
    return _mean_of_directions(accuracy, completeness)


def chamfer_sample_to_sample(predicted: Floats, truth: Floats) -> MetricValue:
    """Mean distance from each sample to the nearest sample of the other surface, in mm.

    With P and G the points drawn on the predicted and the true surface::

        1000 * ( mean_p min_{g in G} |p - g|  +  mean_g min_{p in P} |g - p| ) / 2

    It exceeds the mean of accuracy and completeness, since the nearest sample is farther than the
    nearest point of the surface. Two perfect copies score a sampling floor, on a single flat sheet
    of area A

        500 * sqrt(A / N)    (Clark & Evans, Ecology 35, 1954)

    in mm for N points; less where sheets lie closer together than points, as clothes on skin do;
    about 4 mm for a person. The targets being random as well, the standard error counts both
    directions as if they erred together.

    Args:
        predicted: (N, 3) independent points on the predicted surface, metres.
        truth: (N, 3) points sampled in the same way on the true surface.

    Source: MExECON, "Chamfer", as in the authors' evaluation code.
    """
    there = sample_mean(nearest_sample_mm(predicted, truth), _MM, "independent")
    back = sample_mean(nearest_sample_mm(truth, predicted), _MM, "independent")
    return replace(
        _mean_of_directions(there, back),
        standard_error=(there.standard_error + back.standard_error) / 2,
    )


def _mean_of_directions(there: MetricValue, back: MetricValue) -> MetricValue:
    """Half of each, as if they erred independently of each other."""
    return MetricValue(
        value=(there.value + back.value) / 2,
        unit=there.unit,
        n=there.n + back.n,
        standard_error=float(np.hypot(there.standard_error, back.standard_error)) / 2,
    )
