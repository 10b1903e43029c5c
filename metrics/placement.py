"""Whether two meshes share unit and frame: mistakes that must be caught, not averaged.

A bad reconstruction has to be scored, however bad; a good one in millimetres, with Z up or with its
feet at the origin has to be refused, for its numbers would say nothing about the method. Only a
mesh that was made elsewhere can be such a one: for what a method makes here, ``score`` turns these
refusals into warnings.
"""

from itertools import permutations, product

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError
from harness.geometry.surface import SurfaceIndex

#: Boxes of two meshes in one frame lie closer than this share of the truth's longest side. Feet at
#: the origin instead of the centre give 0.5; half a body that is missing gives 0.25.
_FARTHEST_CENTRES = 0.4
#: A turned frame is suspected only where the misfit exceeds this share of the truth's diagonal.
_NOTABLE_MISFIT = 0.005
#: How many times smaller some turn must make it. Another person in another pose gains 1.4 at most.
_TURN_IS_SUSPECT, _TURN_IS_CERTAIN = 1.5, 2.0
_TURN_POINTS, _TURN_TARGETS = 200, 10_000
#: The longest side of anything that may be a person, in metres.
_PERSON_M = (0.5, 3.0)
_KNOWN_FACTORS = {
    1000.0: "millimetres instead of metres",
    100.0: "centimetres instead of metres",
    39.37: "inches instead of metres",
    0.001: "kilometres, or metres that were divided by 1000",
}


def check_scale_and_place(
    predicted: SurfaceIndex, truth: SurfaceIndex, minimum_ratio: float
) -> None:
    """Refuse boxes of two meshes that cannot belong to one subject in one unit and one frame.

    Args:
        predicted: Reconstruction.
        truth: What it is compared with.
        minimum_ratio: Least ratio of the two boxes' diagonals, either way round.

    Raises:
        DataError: another unit, or boxes that lie apart.
    """
    ratio = float(np.linalg.norm(predicted.extent) / np.linalg.norm(truth.extent))
    if not minimum_ratio <= ratio <= 1 / minimum_ratio:
        raise DataError(
            f"units? {predicted.mesh.source} is {ratio:.4g} times as large as {truth.mesh.source}",
            expected=f"box diagonals with a ratio from {minimum_ratio:g} to {1 / minimum_ratio:g}",
            got=f"sides {_sides(predicted.extent)} against {_sides(truth.extent)}",
            hint=_unit_hint(ratio),
        )
    apart = float(np.linalg.norm(predicted.centre - truth.centre))
    longest = float(truth.extent.max())
    if apart > _FARTHEST_CENTRES * longest:
        raise DataError(
            f"frame? {predicted.mesh.source} and {truth.mesh.source} lie {apart:.3g} m apart",
            expected=f"box centres within {_FARTHEST_CENTRES * longest:.3g} m, "
            f"{_FARTHEST_CENTRES:g} of the truth's longest side",
            got=f"centres {_point(predicted.centre)} and {_point(truth.centre)}",
            hint="Both meshes have to be in the world frame: the origin at the centre of the "
            "subject's box, not at its feet or at a camera",
        )


def check_turn(
    points: Floats, targets: Floats, predicted: SurfaceIndex, truth: SurfaceIndex
) -> list[str]:
    """Refuse a prediction that fits far better when its axes are read differently.

    All 48 ways to read the axes (24 turns, and their mirror images) are tried on some of the
    points, about the box centres, and compared with the prediction both as it lies and moved to the
    truth's centre, so that neither a displacement nor a wrong shape counts as a turn. Distances are
    to some of the samples of the truth, which is quick and near enough.

    Args:
        points: (N, 3) points sampled on the prediction.
        targets: (M, 3) points sampled on the truth.
        predicted: The predicted surface.
        truth: The true surface.

    Returns:
        A warning where the case is not clear enough to refuse.

    Raises:
        DataError: another reading at least halves the misfit; the message names it.
    """
    from scipy.spatial import KDTree

    chosen = _some(points, _TURN_POINTS)
    tree = KDTree(_some(targets, _TURN_TARGETS))
    in_place = float(tree.query(chosen)[0].mean())
    notable = _NOTABLE_MISFIT * float(np.linalg.norm(truth.extent))
    if in_place < notable:
        return []
    readings = _axis_readings()
    turned = [(chosen - predicted.centre) @ reading.T + truth.centre for reading in readings]
    distances, _ = tree.query(np.stack(turned), workers=-1)
    misfits = distances.mean(axis=1).tolist()
    as_given, best = min(in_place, misfits[0]), int(np.argmin(misfits))
    if as_given < max(notable, _TURN_IS_SUSPECT * misfits[best]):
        return []
    what = f"frame? the prediction fits {truth.mesh.source} better with other axes"
    got = (
        f"a misfit of {as_given:.3g} m as given, "
        f"{misfits[best]:.3g} m with {_in_words(readings[best])}"
    )
    if as_given < _TURN_IS_CERTAIN * misfits[best]:
        return [f"{what}: {got}"]
    raise DataError(
        what,
        expected="both meshes in the world frame: +Y up, facing +Z",
        got=got,
        hint="Check which axis is up and which is front in the file: Blender and many scans have "
        "Z up, cameras Y down",
    )


def unit_warnings(truth: SurfaceIndex) -> list[str]:
    """Says where the true surface is not of a person's size, so that metres are in doubt."""
    longest = float(truth.extent.max())
    low, high = _PERSON_M
    if low <= longest <= high:
        return []
    return [
        f"{truth.mesh.source} is {longest:.4g} long, unlike a person in metres: "
        "values in mm are right only if the files are in metres"
    ]


def _some(points: Floats, count: int) -> Floats:
    """About ``count`` of the points, evenly from the first to the last."""
    return points[:: max(1, len(points) // count)]


def _axis_readings() -> list[Floats]:
    """The 48 matrices that map axes to axes; the first one changes nothing."""
    readings = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            reading = np.zeros((3, 3))
            reading[range(3), order] = signs
            readings.append(reading)
    return readings


def _in_words(reading: Floats) -> str:
    """Such as ``(x, z, -y) for (x, y, z)``."""
    names = [("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in reading]
    return f"({', '.join(names)}) for (x, y, z)"


def _unit_hint(ratio: float) -> str:
    for factor, words in _KNOWN_FACTORS.items():
        if 0.6 < ratio / factor < 1.6:
            return f"The prediction may be in {words}: multiply it by {1 / factor:.6g}"
    return "Both have to be in metres; nothing is rescaled here"


def _sides(extent: Floats) -> str:
    return " x ".join(f"{side:.3g}" for side in extent)


def _point(point: Floats) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in point) + ")"
