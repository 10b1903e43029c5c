"""The score of a reconstruction: all metrics of one pair of meshes under one protocol."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

from harness.core.arrays import Floats, Ints
from harness.core.errors import DataError, HarnessError
from harness.core.files.hashing import derive_seed
from harness.core.formats.typed_json import to_json
from harness.core.mesh import Mesh
from harness.core.results import Diagnostics, MetricValue
from harness.core.settings import MetricProtocol
from harness.geometry.surface import SurfaceIndex, SurfacePoints
from metrics.diagnostics import (
    describe_distances,
    describe_mesh,
    doubles_warnings,
    f_scores,
    winding_warnings,
)
from metrics.distance import (
    chamfer_point_to_surface,
    chamfer_sample_to_sample,
    nearest_surface_mm,
    point_to_surface,
)
from metrics.normals import (
    NormalWeights,
    angles_deg,
    compared,
    normal_error,
    normal_summary,
    normals_at,
    weighted,
)
from metrics.placement import check_scale_and_place, check_turn, unit_warnings
from metrics.sampling import sample_surface

#: What becomes of a prediction in another unit, place or frame: an error, or a warning.
Misplaced = Literal["refuse", "tell"]


@dataclass(frozen=True, slots=True, eq=False)
class PointErrors:
    """The errors behind the means, one per point drawn on a surface.

    Attributes:
        points: (N, 3) metres, world frame.
        distances_mm: (N,) to the nearest point of the other surface.
        normal_errors_deg: (N,) between the smooth normals at both; NaN where one has no direction
            and the protocol leaves such points out.
        faces: (N,) the face that each point was drawn on.
        closest_faces: (N,) the face of the other surface that its nearest point lies on.
    """

    points: Floats
    distances_mm: Floats
    normal_errors_deg: Floats
    faces: Ints
    closest_faces: Ints


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """What ``score`` found.

    Attributes:
        protocol: How the numbers were made; numbers of different protocols are not comparable.
        metrics: ``chamfer``, ``p2s_accuracy``, ``p2s_completeness`` and ``normal_error``.
        diagnostics: Percentiles, F-scores and what the meshes are like.
        warnings: What a reader of the numbers should know.
        predicted_points: Errors of the points on the prediction, where asked for.
        truth_points: Errors of the points on the truth, where asked for.
    """

    protocol: MetricProtocol
    metrics: Mapping[str, MetricValue]
    diagnostics: Diagnostics
    warnings: tuple[str, ...]
    predicted_points: PointErrors | None = None
    truth_points: PointErrors | None = None

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, without the errors point by point."""
        return {
            "protocol": {**self.protocol.to_dict(), "sha": self.protocol.sha},
            "metrics": to_json(self.metrics),
            "diagnostics": to_json(self.diagnostics),
            "warnings": list(self.warnings),
        }


def score(
    predicted: Mesh,
    truth: Mesh,
    protocol: MetricProtocol,
    *,
    keep_points: bool = False,
    misplaced: Misplaced = "refuse",
) -> Score:
    """Every metric of a reconstruction against the true surface.

    Nothing is aligned, rescaled, cropped or repaired. The points on the truth depend on the truth
    and the protocol alone, so that all methods are measured at the same points.

    Args:
        predicted: Reconstruction, in metres, world frame.
        truth: The true surface, in the same frame and unit.
        protocol: How many points, how drawn, and which Chamfer.
        keep_points: Whether the errors are wanted point by point.
        misplaced: What to do with a prediction that seems to have another unit or frame: of a mesh
            made elsewhere that is a mistake in its file, to ``refuse``; of a method that ran here
            it is the method's own result, to measure and ``tell``.

    Raises:
        DataError: the meshes do not share unit and frame, have no normals to compare, or hold
            numbers that cannot be searched.
        HarnessError: a protocol that contradicts itself.
    """
    _check_protocol(protocol)
    with ThreadPoolExecutor(max_workers=2) as pool:
        sampling_mine = pool.submit(_Side.of, predicted, "predicted", protocol)
        sampling_true = pool.submit(_Side.of, truth, "truth", protocol)
        mine, true = sampling_mine.result(), sampling_true.result()
    doubts = _doubts(mine, true, protocol, misplaced)
    there = _errors(mine, true, protocol, protocol.normal_weights)
    # The published evaluator looks this way alone; what it lacks cannot have its mistake.
    back = _errors(true, mine, protocol, "barycentric")
    meshes = {"predicted": describe_mesh(mine.surface), "truth": describe_mesh(true.surface)}
    return Score(
        protocol=protocol,
        metrics=_metrics(true, there, back, protocol),
        diagnostics=Diagnostics(
            alignment="none",
            predicted_to_truth=describe_distances(there.distances_mm),
            truth_to_predicted=describe_distances(back.distances_mm),
            f_score=f_scores(there.distances_mm, back.distances_mm),
            normals=normal_summary(compared(there.normal_errors_deg), back.normal_errors_deg),
            meshes=meshes,
        ),
        warnings=(
            *doubts,
            *unit_warnings(true.surface),
            *doubles_warnings({"predicted": mine.surface, "truth": true.surface}),
            *winding_warnings(meshes, compared(there.normal_errors_deg)),
        ),
        predicted_points=there if keep_points else None,
        truth_points=back if keep_points else None,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Side:
    """One of the two meshes, ready to be asked, and the points drawn on it."""

    surface: SurfaceIndex
    samples: SurfacePoints

    @classmethod
    def of(cls, mesh: Mesh, role: str, protocol: MetricProtocol) -> _Side:
        surface = SurfaceIndex(mesh, split_seams=protocol.texture_seams == "split")
        return cls(surface, _drawn(surface, role, protocol))


def _drawn(surface: SurfaceIndex, role: str, protocol: MetricProtocol) -> SurfacePoints:
    seed = derive_seed(protocol.seed, role)
    return sample_surface(surface, protocol.samples, protocol.sampling, seed)


def _doubts(
    mine: _Side, true: _Side, protocol: MetricProtocol, misplaced: Misplaced
) -> tuple[str, ...]:
    """Warnings of another unit, place or frame, as far as these are not refused."""
    try:
        check_scale_and_place(mine.surface, true.surface, protocol.minimum_scale_ratio)
        turns = check_turn(mine.samples.points, true.samples.points, mine.surface, true.surface)
    except DataError as error:
        if misplaced == "refuse":
            raise
        return (f"{error.what}: {error.got}",)
    return tuple(turns)


def _errors(
    sampled: _Side, other: _Side, protocol: MetricProtocol, weights: NormalWeights
) -> PointErrors:
    closest, distances_mm = nearest_surface_mm(sampled.samples.points, other.surface)
    cancelled = protocol.cancelled_normals
    return PointErrors(
        points=sampled.samples.points,
        distances_mm=distances_mm,
        normal_errors_deg=angles_deg(
            normals_at(sampled.surface, sampled.samples, cancelled),
            normals_at(other.surface, weighted(closest, weights), cancelled),
        ),
        faces=sampled.samples.faces,
        closest_faces=closest.faces,
    )


def _metrics(
    true: _Side, there: PointErrors, back: PointErrors, protocol: MetricProtocol
) -> dict[str, MetricValue]:
    accuracy = point_to_surface(there.distances_mm, protocol.sampling)
    completeness = point_to_surface(back.distances_mm, protocol.sampling)
    if protocol.chamfer == "sample-to-sample":
        chamfer = replace(
            chamfer_sample_to_sample(there.points, back.points),
            floor=_sampling_floor_mm(true, protocol),
        )
    else:
        chamfer = chamfer_point_to_surface(accuracy, completeness)
    return {
        "chamfer": chamfer,
        "p2s_accuracy": accuracy,
        "p2s_completeness": completeness,
        "normal_error": normal_error(there.normal_errors_deg, protocol.sampling),
    }


def _sampling_floor_mm(true: _Side, protocol: MetricProtocol) -> float:
    """What the truth itself scores as a prediction: the same points that a perfect copy has."""
    copy = _drawn(true.surface, "predicted", protocol)
    return chamfer_sample_to_sample(copy.points, true.samples.points).value


def _check_protocol(protocol: MetricProtocol) -> None:
    if protocol.samples < 1:
        raise HarnessError(
            f"protocol {protocol.name} draws no points", expected="samples: 1 or more"
        )
    if protocol.chamfer == "sample-to-sample" and protocol.sampling != "independent":
        raise HarnessError(
            f"protocol {protocol.name} contradicts itself",
            expected="sampling: independent with chamfer: sample-to-sample, for only then is the "
            "sampling floor known",
            got=f"sampling: {protocol.sampling}",
        )
