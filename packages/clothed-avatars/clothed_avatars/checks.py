"""The numbers an avatar must have before it is written."""

from __future__ import annotations

import numpy as np

from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.quads import Floats, Ints
from harness.core.errors import DataError
from harness.core.rigs import RingRig
from harness.geometry.coinciding import edges_of

_FRAME_PX = (1080, 1920)
_HEIGHT_M = (1.45, 2.0)


def _euler_number(faces: Ints) -> int:
    count = edges_of(faces).counts
    if not (count == 2).all():
        raise DataError(
            "the avatar's surface is not watertight",
            expected="two faces at every edge",
            got=f"{int((count != 2).sum())} other edges",
        )
    return len(np.unique(faces)) - len(count) + len(faces)


def _outside_frame(vertices: Floats) -> int:
    """How many of the paper rig's eight views cut the subject."""
    middle = 0.5 * (vertices.min(0) + vertices.max(0))
    views = 0
    for camera in RingRig().cameras(*_FRAME_PX):
        at = camera.world_to_camera
        local = (vertices - middle) @ at[:3, :3].T + at[:3, 3]
        pixel = (local @ camera.K.T)[:, :2] / local[:, 2:]
        views += bool(((pixel < 0) | (pixel > np.array(_FRAME_PX))).any())
    return views


def check_frame(name: str, vertices: Floats) -> None:
    """Refuse a body (V,3) that leaves the frame even without hair, clothes and shoes.

    Raises:
        DataError: it does in one of the views of the paper's rig.
    """
    cut = _outside_frame(vertices)
    if cut:
        raise _left_frame(name, vertices, cut)


def _left_frame(name: str, vertices: Floats, cut: int) -> DataError:
    return DataError(
        f"avatar {name} leaves the frame in {cut} of 8 views",
        expected="all of it within 1.2 m x 2.16 m at the subject",
        got=f"{np.ptp(vertices[:, 0]):.2f} m wide, {np.ptp(vertices[:, 2]):.2f} m deep",
        hint="Give it a narrower pose or a smaller height",
    )


def check_avatar(
    name: str,
    vertices: Floats,
    faces: Ints,
    cloth: np.ndarray,
    skin: Nearness,
    *,
    framed: bool = True,
) -> dict[str, object]:
    """What an avatar measures.

    cloth (F,) marks garment faces. Distances from their centres to the true body, mm; angle between
    their normals and the body's at the nearest point, degrees, linings left out.

    Args:
        name: The avatar's.
        vertices: (V, 3) metres.
        faces: (F, 3).
        cloth: (F,) which faces are of garments.
        skin: The true body.
        framed: Whether every view of the paper's rig has to show all of it.

    Raises:
        DataError: not watertight, not 1.45 to 2.0 m high, or cut by a view of the paper's rig.
    """
    euler = _euler_number(faces)
    height = float(np.ptp(vertices[:, 1]))
    if not _HEIGHT_M[0] <= height <= _HEIGHT_M[1]:
        raise DataError(
            f"avatar {name} has a wrong height", expected="1.45 to 2.0 m", got=f"{height:.2f} m"
        )
    cut = _outside_frame(vertices) if framed else 0
    if cut:
        raise _left_frame(name, vertices, cut)
    corners = vertices[faces[cloth]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-15)[:, None]
    points, _, _, body_normals = skin.closest(corners.mean(1))
    distance = np.linalg.norm(corners.mean(1) - points, axis=1) * 1000
    cosine = np.clip(np.einsum("fd,fd->f", normals, body_normals), -1, 1)
    outside = cosine > 0  # not the lining that shows in an open coat or under a hem
    return {
        "vertices": len(vertices),
        "faces": len(faces),
        "height_m": round(height, 4),
        "width_m": round(float(np.ptp(vertices[:, 0])), 4),
        "watertight": True,
        "euler_number": euler,
        "cloth_to_body_mm": round(float(np.average(distance, weights=areas)), 2),
        "cloth_to_body_95_mm": round(float(np.percentile(distance, 95)), 2),
        "cloth_to_body_normals_deg": round(
            float(np.average(np.degrees(np.arccos(cosine[outside])), weights=areas[outside])), 2
        ),
    }
