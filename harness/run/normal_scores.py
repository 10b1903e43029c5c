"""How far a method's normal maps are from the scan's, view by view and side by side.

The scan is cast in the maps' own camera, so that a map is compared where it is, with no mesh made
of it; the fitted body's normals on the same pixels say what the estimate is worth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask
from harness.core.artifacts import NormalMaps, Scan
from harness.core.mesh import Mesh
from harness.core.records import AngularPair, NormalMapErrors
from harness.core.rigs import camera_yaw_deg
from harness.core.truth import face_regions
from harness.geometry.raycast import Raycaster, Side
from metrics.folds import fold_errors, pixel_size_m
from metrics.normals import angular_error_map, angular_errors

#: What the photo shows, and what it hides.
SIDES: tuple[Side, ...] = ("near", "far")


@dataclass(frozen=True, slots=True, eq=False)
class TrueNormals:
    """One side of the scan on the pixels of a view's maps.

    Attributes:
        normals: (H, W, 3) in the frame of maps, 0 beside the scan.
        face: (H, W) index of the scan's face that is met; -1 beside it.
        compared: (H, W) where both the photo and the scan show the subject.
    """

    normals: Floats
    face: NDArray[np.int32]
    compared: Mask


@dataclass(frozen=True, slots=True)
class _Photo:
    """A camera's yaw from the subject's front in degrees, and its pixels' size at the subject."""

    yaw_deg: float
    pixel_m: float


def true_normals(scan: Raycaster, maps: NormalMaps, side: Side) -> TrueNormals:
    """One side of the scan, world metres, in the camera of a view's maps."""
    hits = scan.cast(maps.camera, side)
    normals = scan.normals_at(hits, maps.camera)
    # A crease of a scan may have no normal, though a ray meets it.
    return TrueNormals(normals, hits.face, normals.any(axis=2) & maps.mask)


def normal_map_errors(
    maps: Sequence[NormalMaps], scan: Scan, truth: Mesh
) -> tuple[NormalMapErrors, ...]:
    """The errors of every map, one entry for each view and side; empty without maps.

    Args:
        maps: Handed out by the method.
        scan: Where labels lie.
        truth: The scan's mesh, with its faces in the file's order.

    Raises:
        DataError: labels that are not the scan's, or a map without a normal inside its mask.
    """
    if not maps:
        return ()
    regions = face_regions(scan, truth)
    worn = None if regions is None else regions.worn
    caster = Raycaster(truth.geometry())
    middle = np.mean(truth.bounds, axis=0)
    return tuple(
        _errors(
            each,
            side,
            true_normals(caster, each, side),
            worn,
            _Photo(_yaw_deg(each, scan), pixel_size_m(each.camera, middle)),
        )
        for each in maps
        for side in SIDES
    )


def _yaw_deg(maps: NormalMaps, scan: Scan) -> float:
    """Yaw of the camera from the subject's front towards its left, whole degrees, 0 to 359."""
    return float(round(camera_yaw_deg(maps.camera) - scan.front_yaw_deg) % 360)


def _errors(
    maps: NormalMaps, side: Side, true: TrueNormals, worn: Mask | None, photo: _Photo
) -> NormalMapErrors:
    estimate, body = (
        (maps.front, maps.body_front) if side == "near" else (maps.back, maps.body_back)
    )
    estimate_deg, body_deg = (
        angular_error_map(normals, true.normals, true.compared)[true.compared]
        for normals in (estimate, body)
    )
    clothed = None
    if worn is not None:
        chosen = worn[true.face[true.compared]]
        clothed = _pair(estimate_deg[chosen], body_deg[chosen])
    return NormalMapErrors(
        view=maps.view,
        yaw_deg=photo.yaw_deg,
        side=side,
        clothed=clothed,
        whole=_pair(estimate_deg, body_deg),
        folds=fold_errors(estimate, true.normals, true.compared, photo.pixel_m),
    )


def _pair(estimate_deg: Floats, body_deg: Floats) -> AngularPair:
    return AngularPair(angular_errors(estimate_deg), angular_errors(body_deg))
