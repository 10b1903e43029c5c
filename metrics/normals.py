"""Two surfaces become degrees: the angle between their normals at matched points.

Normals are oriented, so that a surface which is inside out is 180 degrees off. They are
interpolated from area-weighted vertex normals (``SurfaceIndex.smooth_normals``): the face normals
of a scan carry the noise of its vertices, 7 to 14 degrees of it.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.errors import DataError
from harness.core.records import AngularErrors, NormalSummary
from harness.geometry.surface import SurfaceIndex, SurfacePoints

NormalWeights = Literal["barycentric", "permuted"]

#: A corner of less weight than this has none: the point lies on the opposite edge.
_ON_EDGE = 1e-7


def angles_deg(first: Floats, second: Floats) -> Floats:
    """(N,) angles between (N, 3) vectors, 0 to 180 degrees; 0 is exact, unlike with an arc cosine.

    Vectors of length 0 have no angle; they give 0, so keep them out.
    """
    across = np.linalg.norm(np.cross(first, second), axis=1)
    along = np.einsum("ij,ij->i", first, second)
    return np.degrees(np.arctan2(across, along))


def weighted(where: SurfacePoints, weights: NormalWeights) -> SurfacePoints:
    """The points with the weights that a protocol gives to the vertices of their faces.

    ``permuted`` is a mistake of the published evaluator that its numbers contain: Open3D's (u, v)
    weigh the 2nd and the 3rd vertex, and the evaluator gives u to the 1st, v to the 2nd and
    1 - u - v to the 3rd.
    """
    if weights == "barycentric":
        return where
    return replace(where, barycentric=where.barycentric[:, [1, 2, 0]])


def normals_at(
    surface: SurfaceIndex, where: SurfacePoints, cancelled: Literal["face", "left-out"]
) -> Floats:
    """(N, 3) unit normals; where they cancel, those of the faces, or NaN if these are left out."""
    return surface.normals(where) if cancelled == "face" else surface.smooth_normals(where)


def compared(errors_deg: Floats) -> Floats:
    """The errors of the points that have one; a point without a normal is NaN.

    Raises:
        DataError: no point has one.
    """
    known = errors_deg[np.isfinite(errors_deg)]
    if len(known) == 0:
        raise DataError(
            "there is no normal error",
            expected="smooth normals on both meshes",
            got="normals that cancel each other everywhere, as on a sheet without thickness",
        )
    return known


def face_cosines(mine: Floats, true: Floats) -> Floats:
    """(N,) absolute cosines between (N, 3) vectors; 1 where one has no direction, as X-Avatar."""
    lengths = np.linalg.norm(mine, axis=1) * np.linalg.norm(true, axis=1)
    along = np.abs(np.einsum("ij,ij->i", mine, true))
    return np.divide(along, lengths, out=np.ones_like(along), where=lengths > 0)


def facing_faces(surface: SurfaceIndex, closest: SurfacePoints, points: Floats) -> Ints:
    """(N,) the face that trimesh names for the closest point of each of (N, 3) points.

    Where that lies on an edge or at a vertex, two faces are equally close; of these it is the one
    that faces the point more.
    """
    faces = surface.corners.astype(np.int64)
    shared = np.flatnonzero((closest.barycentric <= _ON_EDGE).any(axis=1))
    used = np.zeros(int(faces.max()) + 1, dtype=bool)
    used[faces[closest.faces[shared]]] = True
    # Faces that touch a face in question, by each of their edges and vertices.
    near = np.flatnonzero(used[faces].any(axis=1) & (surface.face_areas > 0))
    ends = np.sort(faces[near][:, [0, 1, 1, 2, 2, 0, 0, 0, 1, 1, 2, 2]].reshape(-1, 2), axis=1)
    keys, owner = ends[:, 0] * len(used) + ends[:, 1], np.repeat(near, 6)
    order = np.argsort(keys, kind="stable")
    keys, owner = keys[order], owner[order]
    # What a closest point lies on: the corners that have weight, one of them twice at a vertex.
    corners = np.where(closest.barycentric[shared] > _ON_EDGE, faces[closest.faces[shared]], -1)
    high = corners.max(axis=1)
    low = np.where(corners >= 0, corners, len(used)).min(axis=1)
    first = np.searchsorted(keys, low * len(used) + high)
    second = np.minimum(first + 1, len(keys) - 1)
    second = np.where(keys[second] == keys[first], second, first)
    rivals = np.stack([owner[first], owner[second]], axis=1)
    normals = surface.face_vectors[rivals] / surface.face_areas[rivals][..., None]
    away = points[shared] - closest.points[shared]
    best = np.einsum("nkc,nc->nk", normals, away).argmax(axis=1)
    found = np.array(closest.faces, dtype=np.int64)
    found[shared] = rivals[np.arange(len(shared)), best]
    return found


def normal_summary(errors_deg: Floats, back_errors_deg: Floats) -> NormalSummary:
    """What tells wrong orientation from wrong shape.

    Args:
        errors_deg: (N,) oriented angles at the predicted points that have one.
        back_errors_deg: (M,) the same at the true points; NaN where a point has none.
    """
    back_known = back_errors_deg[np.isfinite(back_errors_deg)]
    return NormalSummary(
        median_deg=float(np.median(errors_deg)),
        share_over_90=float(np.mean(errors_deg > 90)),
        unoriented_mean_deg=float(np.mean(np.minimum(errors_deg, 180 - errors_deg))),
        truth_to_predicted_mean_deg=float(back_known.mean()) if len(back_known) else None,
    )


#: Pixels that are less off than this are counted.
THRESHOLDS_DEG = (11.25, 22.5, 30.0)


def angular_error_map(predicted: Floats, truth: Floats, mask: Mask) -> Floats:
    """(H, W) angles between two maps of normals (H, W, 3) in degrees; NaN outside the mask (H, W).

    Raises:
        DataError: maps of different shapes, or a pixel of the mask without a normal.
    """
    shape = (*mask.shape, 3)
    if predicted.shape != shape or truth.shape != shape:
        raise DataError(
            "two normal maps cannot be compared: they have different shapes",
            expected=f"{shape}, as the mask",
            got=f"{predicted.shape} and {truth.shape}",
        )
    for name, normals in (("predicted", predicted), ("true", truth)):
        length = np.linalg.norm(normals[mask], axis=1)
        if not (length > 0).all():
            raise DataError(
                f"the {name} normal map has pixels without a normal inside the mask",
                expected="a finite normal everywhere",
                got=f"{int((~(length > 0)).sum())} of {int(mask.sum())} pixels without",
            )
    errors_deg = np.full(mask.shape, np.nan)
    errors_deg[mask] = angles_deg(predicted[mask], truth[mask])
    return errors_deg


def angular_errors(errors_deg: Floats) -> AngularErrors:
    """The summary of the errors (N,) of some pixels, degrees."""
    if not len(errors_deg):
        return AngularErrors(None, None, None, None, None, 0)
    low, middle, high = (float(np.mean(errors_deg < limit)) for limit in THRESHOLDS_DEG)
    return AngularErrors(
        mean_deg=float(np.mean(errors_deg)),
        median_deg=float(np.median(errors_deg)),
        share_below_11_25=low,
        share_below_22_5=middle,
        share_below_30=high,
        n=len(errors_deg),
    )
