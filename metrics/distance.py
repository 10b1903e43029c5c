"""Two surfaces become millimetres: accuracy, completeness and Chamfer distance.

Points are drawn on both surfaces. How far the predicted ones lie from the true surface is the
accuracy; how far the true ones lie from the predicted surface is the completeness, which alone
punishes holes. ICON, ECON and their heirs call the completeness "P2S", PIFu the accuracy.

Chamfer is half of each direction. From points to *surfaces* two perfect copies score 0. From points
to *points* they score a sampling floor, on a single flat sheet of area A::

    500 * sqrt(A / N)    (Clark & Evans, Ecology 35, 1954)

in mm for N points; less where sheets lie closer together than points, as clothes on skin do; about
4 mm for a person.

Before: ``methods/hull.py``. After: ``harness/pipeline/run/evaluate.py``.
"""

from __future__ import annotations

import numpy as np

from harness.core.arrays import Floats, Ints
from harness.core.results import MetricValue
from harness.core.units import MM_PER_METRE
from harness.geometry.surface import SurfaceIndex, SurfacePoints


def nearest_surface_mm(points: Floats, surface: SurfaceIndex) -> tuple[SurfacePoints, Floats]:
    """The nearest point of a surface to each of (N, 3) points in metres, and how far it is, in mm.

    Exact: it may lie on a face, on an edge or at a vertex.
    """
    closest, distances = surface.closest(points)
    return closest, distances * MM_PER_METRE


def nearest_samples(points: Floats, targets: Floats) -> tuple[Floats, Ints]:
    """(N,) how far the nearest of (M, 3) target points is from each of (N, 3), and which it is."""
    from scipy.spatial import KDTree

    distances, which = KDTree(targets).query(points, workers=-1)
    return distances, np.asarray(which, dtype=np.int64)


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
