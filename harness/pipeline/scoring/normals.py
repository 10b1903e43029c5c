"""How far a method's normal maps are from the scan's, view by view and side by side, in a record.

The scan is cast in the maps' own camera, so that a map is compared where it is, with no mesh made
of it; the fitted body's normals on the same pixels say what the estimate is worth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask
from harness.core.artifacts import NormalMaps, Scan
from harness.core.cameras.rigs import camera_yaw_deg
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster, Side
from harness.pipeline.scoring.meshes import labelled_faces
from metrics.normal_maps import angular_error_map, angular_errors

__all__ = ["SIDES", "TrueNormals", "normal_details", "true_normals"]


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


def true_normals(scan: Raycaster, maps: NormalMaps, side: Side) -> TrueNormals:
    """One side of the scan, world metres, in the camera of a view's maps."""
    hits = scan.cast(maps.camera, side)
    normals = scan.normals_at(hits, maps.camera)
    # A crease of a scan may have no normal, though a ray meets it.
    return TrueNormals(normals, hits.face, normals.any(axis=2) & maps.mask)


def normal_details(maps: Sequence[NormalMaps], scan: Scan, truth: Mesh) -> dict[str, object]:
    """``{"normal_maps": [...]}`` for a record's details, one entry per view and side.

    An entry says which photo (``view``, and ``yaw_deg`` of its camera: 0 is the subject's front)
    and which ``side``, and has the errors of ``estimate`` and ``body`` over ``all`` pixels of the
    subject, and over those of garments and shoes, ``clothed``, which is None without labels.
    Without maps there are no details.

    Args:
        maps: Handed out by the method.
        scan: Where labels lie.
        truth: The scan's mesh, with its faces in the file's order.

    Raises:
        DataError: labels that are not the scan's, or a map without a normal inside its mask.
    """
    if not maps:
        return {}
    regions = labelled_faces(scan, truth)
    worn = None if regions is None else regions.worn
    caster = Raycaster(truth.geometry())
    entries = [
        {"view": each.view, "yaw_deg": _yaw_deg(each, scan), **_entry(each, side, caster, worn)}
        for each in maps
        for side in SIDES
    ]
    return {"normal_maps": entries}


def _yaw_deg(maps: NormalMaps, scan: Scan) -> float:
    """Of the camera from the subject's front, whole degrees, 0 to 359, towards its left."""
    return float(round(camera_yaw_deg(maps.camera) - scan.front_yaw_deg) % 360)


def _entry(maps: NormalMaps, side: Side, caster: Raycaster, worn: Mask | None) -> dict[str, object]:
    true = true_normals(caster, maps, side)
    pairs = {
        "near": {"estimate": maps.front, "body": maps.body_front},
        "far": {"estimate": maps.back, "body": maps.body_back},
    }
    errors_deg = {
        name: angular_error_map(normals, true.normals, true.compared)[true.compared]
        for name, normals in pairs[side].items()
    }
    clothed = None if worn is None else worn[true.face[true.compared]]
    return {
        "side": side,
        "clothed": None if clothed is None else _summaries(errors_deg, clothed),
        "all": _summaries(errors_deg, slice(None)),
    }


def _summaries(errors_deg: dict[str, Floats], chosen: Mask | slice) -> dict[str, object]:
    return {name: angular_errors(values[chosen]).to_dict() for name, values in errors_deg.items()}
