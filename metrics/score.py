"""The score of a reconstruction: all metrics of one pair of meshes under one protocol."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from harness.core.arrays import Floats, Ints
from harness.core.errors import DataError, HarnessError
from harness.core.mesh import Mesh
from harness.core.protocol_stages import UNALIGNED, Aligned
from harness.core.records import Diagnostics, DistanceSummary, FScore, MeshFacts, MetricValue
from harness.core.settings import MetricProtocol
from harness.core.truth import FaceRegions
from harness.core.typed_json import to_json
from harness.core.units import MM_PER_METRE
from harness.geometry.surface import SurfaceIndex
from metrics.normals import compared, normal_summary
from metrics.pair import Pair, Placed
from metrics.placement import check_scale_and_place, check_turn, unit_warnings
from metrics.summary import measured, normal_angles, part_numbers

F_SCORE_THRESHOLDS_MM = (5, 10, 20, 50)
#: Faces of a closed surface cancel as vectors. Up to this share of the area, what is open is too
#: little to let the sign of the volume depend on the origin.
_NEARLY_CLOSED = 0.05
#: Less volume than this, in cubes as large as the area, is none: a surface that is there twice.
_NO_VOLUME = 1e-9


def describe_distances(distances_mm: Floats) -> DistanceSummary:
    """Percentiles of (N,) distances, and their maximum."""
    p50, p90, p95, p99 = np.percentile(distances_mm, (50, 90, 95, 99))
    return DistanceSummary(
        p50_mm=float(p50),
        p90_mm=float(p90),
        p95_mm=float(p95),
        p99_mm=float(p99),
        max_sampled_mm=float(distances_mm.max()),
    )


def f_scores(accuracy_mm: Floats, completeness_mm: Floats) -> dict[str, FScore]:
    """Precision, recall and their harmonic mean by threshold, such as ``5_mm``.

    Source: Knapitsch et al., Tanks and Temples, 2017; here from points to surfaces. F is 0 where
    precision and recall both are.

    Args:
        accuracy_mm: (N,) distances of predicted points to the true surface.
        completeness_mm: (M,) distances of true points to the predicted surface.
    """
    scores = {}
    for threshold in F_SCORE_THRESHOLDS_MM:
        precision = float(np.mean(accuracy_mm < threshold))
        recall = float(np.mean(completeness_mm < threshold))
        both = precision + recall
        f_score = 2 * precision * recall / both if both > 0 else 0.0
        scores[f"{threshold}_mm"] = FScore(precision=precision, recall=recall, f=f_score)
    return scores


def describe_mesh(surface: SurfaceIndex) -> MeshFacts:
    """Size and health of a mesh."""
    mesh = surface.mesh
    open_part = np.linalg.norm(surface.face_vectors.sum(axis=0)) / 2
    volume = surface.signed_volume if open_part < _NEARLY_CLOSED * surface.area else None
    width, height, depth = surface.extent.tolist()
    return MeshFacts(
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        faces_without_area=int((surface.face_areas == 0).sum()),
        extent_m=(width, height, depth),
        area_m2=surface.area,
        signed_volume_m3=volume,
        inverted=None
        if volume is None or abs(volume) < _NO_VOLUME * surface.area**1.5
        else volume < 0,
    )


def doubles_warnings(surfaces: Mapping[str, SurfaceIndex]) -> list[str]:
    """Says which meshes, by their role, have faces at the places of others."""
    warnings: list[str] = []
    for role, surface in surfaces.items():
        extra, turned = int(surface.doubles.extra.sum()), int(surface.doubles.turned.sum())
        if extra:
            warnings.append(
                f"{extra} of {len(surface.mesh.faces)} faces of the {role} mesh lie where others "
                f"do, {turned} of them the other way round: areas count them, normals do not"
            )
    return warnings


def winding_warnings(meshes: Mapping[str, MeshFacts], normal_errors_deg: Floats) -> list[str]:
    """Says where faces wound inside out, rather than shape, drive the normal error.

    Args:
        meshes: ``describe_mesh`` of each mesh, by its role.
        normal_errors_deg: (N,) oriented angles.
    """
    warnings = [
        f"the {role} mesh is inside out: its faces are wound clockwise seen from outside"
        for role, facts in meshes.items()
        if facts.inverted
    ]
    opposed = float(np.mean(normal_errors_deg > 90))
    if not warnings and opposed > 0.5:
        warnings.append(
            f"{opposed:.0%} of the predicted normals point away from the true ones: "
            "faces may be wound inside out"
        )
    return warnings


#: What the truth itself does not score 0 or 1 in, because of points or edges.
_WITH_FLOOR = frozenset({"samples", "sample_cosine", "surface_cosine", "edges"})
#: The protocol whose program measures hands and face apart.
_WITH_PARTS = "xavatar"
#: Axes are looked at with these points, whatever the protocol's own.
_TURN_SAMPLES: dict[str, Any] = {"samples": 30_000, "sampling": "independent"}
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
        metrics: Those of the protocol's summary, by key.
        diagnostics: Percentiles, F-scores and what the meshes are like; None under protocols that
            compare no smooth normals.
        alignment: What was done to the prediction first.
        warnings: What a reader of the numbers should know.
        predicted_points: Errors of the points on the prediction, where asked for.
        truth_points: Errors of the points on the truth, where asked for.
    """

    protocol: MetricProtocol
    metrics: Mapping[str, MetricValue]
    diagnostics: Diagnostics | None
    warnings: tuple[str, ...]
    alignment: Aligned = UNALIGNED
    predicted_points: PointErrors | None = None
    truth_points: PointErrors | None = None

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, without the errors point by point."""
        return {
            "protocol": {
                **self.protocol.to_dict(),
                "sha": self.protocol.sha,
                "stages": self.protocol.stages,
            },
            "alignment": to_json(self.alignment),
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
    """Every metric of a reconstruction against the true surface under one protocol.

    Nothing is rescaled, cropped or repaired, and aligned only where the protocol says so. The
    points on the truth depend on the truth and the protocol alone, so that all methods are measured
    at the same points.

    Args:
        predicted: Reconstruction, in metres, world frame.
        truth: The true surface, in the same frame and unit.
        protocol: How.
        keep_points: Whether the errors are wanted point by point.
        misplaced: What to do with a prediction that seems to have another unit or frame: of a mesh
            made elsewhere that is a mistake in its file, to ``refuse``; of a method that ran here
            it is the method's own result, to measure and ``tell``.

    Raises:
        DataError: the meshes do not share unit and frame, have no normals to compare, or hold
            numbers that cannot be searched.
        HarnessError: a protocol that contradicts itself, or that has no errors point by point.
    """
    _check_protocol(protocol)
    return _score(Pair(predicted, truth), protocol, keep_points, misplaced)


def score_all(
    predicted: Mesh,
    truth: Mesh,
    protocols: Sequence[MetricProtocol],
    *,
    keep_points: bool = False,
    misplaced: Misplaced = "refuse",
    regions: FaceRegions | None = None,
) -> dict[str, Score | HarnessError]:
    """As ``score``, under several protocols that share what is alike, by the protocol's name.

    Where one protocol cannot measure the two meshes, its place has the reason. Where the regions of
    the true faces are known, ``xavatar`` measures hands and face apart as well.

    Raises:
        DataError: meshes that no protocol can measure.
        HarnessError: a protocol that contradicts itself.
    """
    for protocol in protocols:
        _check_protocol(protocol)
    pair = Pair(predicted, truth)
    found: dict[str, Score | HarnessError] = {}
    for protocol in protocols:
        try:
            one = _score(pair, protocol, keep_points, misplaced)
            if regions is not None and protocol.name == _WITH_PARTS:
                apart = part_numbers(pair.placed(protocol), protocol, regions)
                one = replace(one, metrics={**one.metrics, **apart})
            found[protocol.name] = one
        except HarnessError as error:
            found[protocol.name] = error
    reasons = [each for each in found.values() if isinstance(each, HarnessError)]
    if reasons and len(reasons) == len(found):
        raise reasons[0]
    return found


def _score(pair: Pair, protocol: MetricProtocol, keep_points: bool, misplaced: Misplaced) -> Score:
    doubts = _doubts(pair, protocol, misplaced)
    placed = pair.placed(protocol)
    found = Score(
        protocol=protocol,
        metrics={},
        diagnostics=None,
        warnings=(*doubts, *unit_warnings(pair.true.index)),
        alignment=placed.alignment,
    )
    if any(column.of == "angle" for column in protocol.columns):
        found = _with_angles(found, placed, keep_points)
    elif keep_points:
        raise HarnessError(
            f"protocol {protocol.name} has no errors point by point",
            expected="a protocol with smooth normals, such as mexecon or exact",
        )
    return replace(found, metrics=_metrics(pair, placed, found))


def _with_angles(found: Score, placed: Placed, keep_points: bool) -> Score:
    """What stands behind the means where smooth normals are compared."""
    there, back = (_errors(placed, found.protocol, back=back) for back in (False, True))
    meshes = {
        "predicted": describe_mesh(placed.mine.index),
        "truth": describe_mesh(placed.true.index),
    }
    angles = compared(there.normal_errors_deg)
    return replace(
        found,
        diagnostics=Diagnostics(
            alignment=placed.alignment.by,
            predicted_to_truth=describe_distances(there.distances_mm),
            truth_to_predicted=describe_distances(back.distances_mm),
            f_score=f_scores(there.distances_mm, back.distances_mm),
            normals=normal_summary(angles, back.normal_errors_deg),
            meshes=meshes,
        ),
        warnings=(
            *found.warnings,
            *doubles_warnings({"predicted": placed.mine.index, "truth": placed.true.index}),
            *winding_warnings(meshes, angles),
        ),
        predicted_points=there if keep_points else None,
        truth_points=back if keep_points else None,
    )


def _doubts(pair: Pair, protocol: MetricProtocol, misplaced: Misplaced) -> tuple[str, ...]:
    """Warnings of another unit, place or frame, as far as these are not refused."""
    if protocol.alignment.by in ("boxes", "height"):
        return ()
    rule = replace(protocol, **_TURN_SAMPLES)
    mine, true, ratio = pair.mine, pair.true, protocol.minimum_scale_ratio
    try:
        check_scale_and_place(mine.index, true.index, ratio)
        points = mine.samples(rule).points, true.samples(rule).points
        turns = pair.once(("turn", rule.seed), lambda: check_turn(*points, mine.index, true.index))
    except DataError as error:
        if misplaced == "refuse":
            raise
        return (f"{error.what}: {error.got}",)
    return tuple(turns)


def _errors(placed: Placed, protocol: MetricProtocol, *, back: bool) -> PointErrors:
    drawn = placed.sides(back=back)[0].samples(protocol)
    closest, distances = placed.closest(protocol, back=back)
    return PointErrors(
        points=drawn.points,
        distances_mm=distances * MM_PER_METRE,
        normal_errors_deg=normal_angles(placed, protocol, back=back),
        faces=drawn.faces,
        closest_faces=closest.faces,
    )


def _metrics(pair: Pair, placed: Placed, found: Score) -> dict[str, MetricValue]:
    """The protocol's columns, each with what the truth itself scores."""
    metrics = {}
    for column in found.protocol.columns:
        value = measured(placed, found.protocol, column)
        if column.of in _WITH_FLOOR:
            # The same points that a perfect copy has.
            copy = measured(pair.copied(found.protocol), found.protocol, column)
            value = replace(value, floor=copy.value)
        elif column.of in ("boxes", "volume"):
            value = replace(value, floor=1.0)
        metrics[column.key] = value
    return metrics


def _check_protocol(protocol: MetricProtocol) -> None:
    if protocol.samples < 1:
        raise HarnessError(
            f"protocol {protocol.name} draws no points", expected="samples: 1 or more"
        )
    uses = {column.of for column in protocol.columns}
    if uses & {"samples", "sample_cosine"} and protocol.sampling == "stratified":
        raise HarnessError(
            f"protocol {protocol.name} contradicts itself",
            expected="sampling: independent with chamfer: sample-to-sample, for only then is the "
            "sampling floor known",
            got=f"sampling: {protocol.sampling}",
        )
