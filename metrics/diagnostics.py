"""What stands behind the means: percentiles, F-scores, and whether a mesh is inside out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from harness.core.arrays import Floats
from harness.core.results import DistanceSummary, FScore, MeshFacts
from harness.geometry.surface import SurfaceIndex

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
