"""How far estimated cameras are from the true ones, pair by pair and after a Sim(3) by cameras.

Positions are compared after the similarity of the centres, as others do, pixels after that of the
pictures: what no photo shows is no error there.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.records import MetricValue
from harness.core.units import MM_PER_METRE
from harness.geometry.similarity import camera_similarity, similarity_of_pictures

#: Thresholds of the area under the curve, degrees, as VGGT and its kin print them.
AUC_DEG = (1, 3, 5, 10)


def camera_errors(
    found: Sequence[Camera], known: Sequence[Camera], points: Floats
) -> dict[str, MetricValue]:
    """Errors of cameras by metric id: of pairs, and what is left after the Sim(3) by cameras.

    The area under the curve up to a threshold t is the mean over all pairs of ``max(0, 1 - e / t)``
    with e the larger of the pair's two errors: of its relative rotation, and of its baseline's
    direction in the first camera.

    Args:
        found: In a world of their own, two or more.
        known: The true ones of the same pictures, world metres.
        points: (N, 3) of the true surface, for the reprojection error.

    Raises:
        MethodError: cameras that do not stand as the known ones do.
    """
    pairs = list(combinations(range(len(known)), 2))
    turns, ways = (np.array([error(found, known, *pair) for pair in pairs])
                   for error in (_turn_deg, _direction_deg))  # fmt: skip
    by_centres = camera_similarity(found, known).similarity
    by_pictures = similarity_of_pictures(found, known)
    apart = [MM_PER_METRE * float(np.linalg.norm(by_centres.camera(a).position - b.position))
             for a, b in zip(found, known, strict=True)]  # fmt: skip
    pixels = [
        np.linalg.norm(by_pictures.camera(a).project(points)[0] - b.project(points)[0], axis=1)
        for a, b in zip(found, known, strict=True)
    ]
    seen = np.concatenate(pixels)
    seen = seen[np.isfinite(seen)]
    if not len(seen):
        raise MethodError("the estimated cameras do not see the subject")
    worst = np.maximum(turns, ways)
    return {
        "camera_rotation": _value(turns, "deg"),
        "camera_direction": _value(ways, "deg"),
        **{f"camera_auc_{t}": _value(np.maximum(0, 1 - worst / t), "ratio") for t in AUC_DEG},
        "camera_position": _value(np.array(apart), "mm"),
        "camera_reprojection": MetricValue(float(np.sqrt((seen**2).mean())), "px", len(seen), 0.0),
    }


def _value(values: Floats, unit: str) -> MetricValue:
    return MetricValue(float(values.mean()), unit, len(values), 0.0)


def _turn_deg(found: Sequence[Camera], known: Sequence[Camera], i: int, j: int) -> float:
    own, goal = (some[j].rotation @ some[i].rotation.T for some in (found, known))
    difference = own @ goal.T
    # The chord tells small angles, which the trace rounds away.
    chord = float(np.linalg.norm(difference - np.eye(3))) / (2 * np.sqrt(2))
    return float(np.degrees(2 * np.arcsin(min(chord, 1.0))))


def _direction_deg(found: Sequence[Camera], known: Sequence[Camera], i: int, j: int) -> float:
    own, goal = (
        some[i].rotation @ (some[j].position - some[i].position) for some in (found, known)
    )
    across = float(np.linalg.norm(np.cross(own, goal)))
    return float(np.degrees(np.arctan2(across, float(own @ goal))))
