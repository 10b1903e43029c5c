"""Depth maps to triangles: one open sheet for the front, one for the back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness.core.arrays import Floats, Ints32, Mask
from harness.core.cameras.camera import Camera
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.geometry.topology import pieces_of


@dataclass(frozen=True, slots=True)
class SheetParameters:
    """Which triangles of a sheet are kept; the defaults are the published ones.

    Attributes:
        least_facing: A face is stretched, and dropped, when the cosine between its normal and the
            line of sight is not above this.
        least_component: A component is dropped when it holds no more than this share of vertices.
    """

    least_facing: float = 0.2
    least_component: float = 0.01


def front_back_sheets(
    front: ArrayLike,
    back: ArrayLike,
    camera: Camera,
    parameters: SheetParameters | None = None,
) -> tuple[Mesh, Mesh]:
    """The front and the back sheet as world meshes in metres, both facing outwards.

    Args:
        front: (H, W) depth in metres along the optical axis, NaN where there is no surface.
        back: (H, W) depth of the far side, seen by the same camera.
        camera: The camera of both maps; vertices are at its pixel centres.
        parameters: Which faces are kept; None takes the published rules.

    Raises:
        DataError: a map of another size than the camera, or one that leaves no triangle.
    """
    rules = parameters or SheetParameters()
    return (
        depth_sheet(front, camera, rules, away=False),
        depth_sheet(back, camera, rules, away=True),
    )


def depth_sheet(
    depth: ArrayLike, camera: Camera, parameters: SheetParameters, *, away: bool
) -> Mesh:
    """One depth map (H, W), metres, as a world mesh; it faces the camera, or away from it.

    Raises:
        DataError: a map of another size than the camera, or one that leaves no triangle.
    """
    depth = np.asarray(depth, dtype=np.float64)
    name = "back sheet" if away else "front sheet"
    if depth.shape != (camera.height, camera.width):
        raise DataError(
            f"{name} and camera do not match",
            expected=f"depth of shape {(camera.height, camera.width)}",
            got=str(depth.shape),
        )
    valid = np.isfinite(depth)
    faces = _grid_faces(valid, away)
    vertices = camera.unproject(camera.pixel_centres()[valid], depth[valid])
    keep = _facing(vertices, faces, camera.position) > parameters.least_facing
    keep[keep] = in_large_piece(faces[keep], parameters.least_component)
    if not keep.any():
        raise DataError(
            f"{name} has no triangle left",
            expected="at least one patch of four neighbouring pixels that faces the camera",
            got=f"{int(valid.sum())} pixels with depth",
            hint="Look at the normal maps and the silhouette",
        )
    return Mesh(vertices, faces, source=name).submesh(keep)


def in_large_piece(faces: Ints32, least_share: float) -> Mask:
    """(F,) whether a face's piece holds more than ``least_share`` of the vertices in use."""
    if len(faces) == 0:
        return np.zeros(0, dtype=bool)
    pieces = pieces_of(faces, int(faces.max()) + 1)
    share = pieces.vertex_counts / len(np.unique(faces))
    return share[pieces.of_face] > least_share


def _grid_faces(valid: Mask, away: bool) -> Ints32:
    """Two triangles per square of four valid pixels, counter-clockwise from outside.

    Indices count the valid pixels row by row.
    """
    index = np.cumsum(valid.ravel(), dtype=np.int32).reshape(valid.shape) - 1
    whole = valid[:-1, :-1] & valid[:-1, 1:] & valid[1:, :-1] & valid[1:, 1:]
    top_left, top_right = index[:-1, :-1][whole], index[:-1, 1:][whole]
    low_left, low_right = index[1:, :-1][whole], index[1:, 1:][whole]
    faces = np.concatenate(
        [
            np.stack([top_left, low_left, top_right], axis=1),
            np.stack([top_right, low_left, low_right], axis=1),
        ]
    )
    return faces[:, ::-1] if away else faces


def _facing(vertices: Floats, faces: Ints32, eye: Floats) -> Floats:
    """(F,) absolute cosine between each face's normal and the line of sight to its centre."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    sight = (a + b + c) / 3.0 - eye
    length = np.linalg.norm(normal, axis=1) * np.linalg.norm(sight, axis=1)
    return np.abs(np.einsum("ij,ij->i", normal, sight)) / np.maximum(length, np.finfo(float).tiny)
